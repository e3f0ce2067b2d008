//! A slice of the campaign of hostile surroundings (docs/chaos.md): one run of each of these kinds that took effect. The
//! whole is `cargo bench --bench surroundings`.

#[path = "../benches/surroundings/kind.rs"]
mod kind;
#[path = "../benches/surroundings/machine.rs"]
mod machine;
#[path = "../benches/surroundings/memory_group.rs"]
mod memory_group;
#[path = "../benches/surroundings/pipes.rs"]
mod pipes;
#[path = "../benches/surroundings/place.rs"]
mod place;
#[path = "../benches/surroundings/random.rs"]
mod random;
#[path = "../benches/surroundings/surroundings.rs"]
mod surroundings;
#[path = "../benches/surroundings/trial.rs"]
mod trial;
#[path = "../benches/chaos/undisturbed.rs"]
mod undisturbed;
#[path = "../benches/surroundings/watch.rs"]
mod watch;

use std::fs;
use std::time::{Duration, Instant};

use kind::Kind;
use machine::Machine;
use trial::{Expected, Trial};

/// In order of what they found; no other is begun after so long.
const KINDS: [Kind; 10] = [
    Kind::DiskBursts,
    Kind::DiskFull,
    Kind::KillManager,
    Kind::LimitFiles,
    Kind::LimitFileSize,
    Kind::StreamsFull,
    Kind::StreamsBroken,
    Kind::StopChildren,
    Kind::Interrupt,
    Kind::Mixed,
];
const TIME: Duration = Duration::from_secs(40);
/// The disturbance of a seed may come too late.
const SEEDS: u64 = 3;

#[test]
fn hostile_surroundings_leave_the_right_image_or_a_clear_failure_and_nothing_else() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let room = folder.path().join("room");
    fs::create_dir(&room).expect("a folder");
    let (start, before) = (Instant::now(), Machine::now());
    let mut took_effect = 0;
    for (number, kind) in KINDS.into_iter().enumerate() {
        if start.elapsed() > TIME {
            eprintln!("LEFT OUT after {} s: {:?}", TIME.as_secs(), &KINDS[number..]);
            break;
        }
        for seed in 0..SEEDS {
            let trial = Trial::new(kind, seed);
            let (scene, side) = trial.image();
            let sha256 = undisturbed::undisturbed(scene, side, folder.path());
            let png = fs::read(folder.path().join("render.png")).expect("an image");
            let outcome = match trial.run(&room, &Expected { sha256, png }, None) {
                Ok(outcome) => outcome,
                Err(why) => return eprintln!("SKIPPED hostile surroundings: {why}"),
            };
            eprintln!("{} seed {seed}, {}: {}", kind.name(), trial.settings(), outcome.verdict());
            assert!(outcome.faults.is_empty(), "{:?}\n{:?}\n{}", outcome.faults, outcome.done, trial.command());
            if !outcome.confirmed.is_empty() {
                took_effect += 1;
                break;
            }
        }
    }
    assert!(took_effect > 0, "no disturbance took effect");
    assert_eq!(Machine::now().changes(&before), Vec::<String>::new(), "devices, mounts and control groups stay");
}
