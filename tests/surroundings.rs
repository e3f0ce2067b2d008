//! A slice of the campaign of hostile surroundings (docs/chaos.md): one run of each kind, as many as its time
//! allows. The whole is `cargo bench --bench surroundings`.

#[path = "../benches/surroundings/disk.rs"]
mod disk;
#[path = "../benches/surroundings/kind.rs"]
mod kind;
#[path = "../benches/surroundings/machine.rs"]
mod machine;
#[path = "../benches/surroundings/memory_group.rs"]
mod memory_group;
#[path = "../benches/surroundings/namespaces.rs"]
mod namespaces;
#[path = "../benches/surroundings/pipes.rs"]
mod pipes;
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

use std::collections::HashMap;
use std::fs;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::scope;
use std::time::{Duration, Instant};

use kind::Kind;
use machine::Machine;
use trial::{Expected, Trial};

/// At a time.
const TRIALS: usize = 2;
/// No other is begun after so long.
const TIME: Duration = Duration::from_secs(40);

#[test]
fn hostile_surroundings_leave_the_right_image_or_a_clear_failure_and_nothing_else() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (start, before) = (Instant::now(), Machine::now());
    let (next, took_effect, images) = (AtomicUsize::new(0), AtomicUsize::new(0), Mutex::new(HashMap::new()));
    let work = || -> Result<(), String> {
        while let Some(&kind) = Kind::ALL.get(next.fetch_add(1, Ordering::Relaxed)) {
            if start.elapsed() > TIME {
                eprintln!("LEFT OUT after {} s: {kind:?}", TIME.as_secs());
                continue;
            }
            let trial = Trial::new(kind, 0);
            let mut images = images.lock().expect("no panic");
            let expected = images.entry(trial.image()).or_insert_with(|| Expected::of(&trial, folder.path())).clone();
            drop(images);
            let room = folder.path().join(kind.name());
            fs::create_dir(&room).expect("a folder");
            let outcome = trial.run(&room, &expected, None)?;
            assert!(outcome.faults.is_empty(), "{:#?}\n{:#?}\n{}", outcome.faults, outcome.done, trial.command());
            took_effect.fetch_add(usize::from(kind.took_effect(&outcome.confirmed)), Ordering::Relaxed);
        }
        Ok(())
    };
    let results = scope(|scope| {
        let workers: Vec<_> = (0..TRIALS).map(|_| scope.spawn(work)).collect();
        workers.into_iter().map(|worker| worker.join().expect("no fault")).collect::<Result<Vec<()>, String>>()
    });
    if let Err(why) = results {
        return eprintln!("SKIPPED hostile surroundings: {why}");
    }
    let took_effect = took_effect.into_inner();
    eprintln!("{took_effect} disturbances took effect in {:.0} s", start.elapsed().as_secs_f64());
    assert!(took_effect > 5, "{took_effect} disturbances took effect");
    assert_eq!(Machine::now().changes(&before), Vec::<String>::new(), "devices, mounts and control groups stay");
}
