//! What a command is about, as it is named: a topology file, or a scene by itself.

use std::path::Path;

use super::Failure;
use cluster::processes::manager;
use cluster::topology::{Override, Topology};
use trace::scene::SceneSource;
use trace::scene::procedural::Kind;

/// A topology file, or the topology of a scene alone.
///
/// # Errors
/// What is wrong with it; or that it is neither, and what it could be.
pub(super) fn topology(name: &Path, sets: &[Override]) -> Result<Topology, Failure> {
    let refuse = |what: String| Err(Failure::bad_input(format!("{}: {what}", name.display())));
    if name.is_dir() {
        return if manager::resolved_topology(name).exists() {
            refuse(format!(
                "is the folder of a run, expected a topology or a scene; `marti run --resume {}` goes on with it",
                name.display()
            ))
        } else {
            refuse("is a folder, expected a topology file or a scene".to_owned())
        };
    }
    match name.to_str().map(str::parse::<SceneSource>) {
        Some(Ok(SceneSource::File(path))) if is_scene(&path) => Ok(Topology::of_scene(&SceneSource::File(path), sets)?),
        Some(Ok(scene @ SceneSource::Procedural(_))) if !name.exists() => Ok(Topology::of_scene(&scene, sets)?),
        Some(Err(expected)) if !name.exists() && names_a_size(name) => refuse(expected),
        Some(Err(_)) if !name.exists() => {
            refuse(format!("no such file, expected a topology file, a scene ending in .nff or .obj, or {}", Kind::LIST))
        }
        _ => Ok(Topology::read(name, sets)?),
    }
}

/// By its extension.
pub(super) fn is_topology(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|extension| ["nff", "obj"].iter().any(|known| extension.eq_ignore_ascii_case(known)))
}

/// As in `gears:0`.
fn names_a_size(name: &Path) -> bool {
    let kind = name.to_str().and_then(|name| name.split_once(':')).map(|(kind, _)| kind.parse::<Kind>());
    matches!(kind, Some(Ok(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(name: &Path) -> String {
        topology(name, &[]).expect_err("no topology").message
    }

    #[test]
    fn scenes_and_topologies_are_told_apart() {
        let of = |name: &str| topology(Path::new(name), &[]).unwrap_or_else(|failure| panic!("{failure}"));
        assert_eq!(of("gears:2").scene.to_string(), "gears:2");
        assert_eq!(of("teapot").scene.to_string(), "teapot:12");
        assert_eq!(of("none/House.OBJ").scene.to_string(), "none/House.OBJ", "it is read later");
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../topologies/teapot.toml");
        assert_eq!(topology(&file, &[]).expect("a topology").name, "teapot");
    }

    #[test]
    fn what_is_neither_is_refused_with_what_was_meant() {
        let folder = tempfile::tempdir().expect("a folder");
        assert!(refusal(folder.path()).ends_with("is a folder, expected a topology file or a scene"));
        std::fs::write(folder.path().join("topology.toml"), "").expect("a file");
        let message = refusal(folder.path());
        assert!(
            message.ends_with(&format!("`marti run --resume {}` goes on with it", folder.path().display())),
            "{message}"
        );
        assert!(
            refusal(Path::new("teapto")).starts_with("teapto: no such file, expected a topology file, a scene ending")
        );
        assert!(refusal(Path::new("gears:0")).ends_with("expected a size from 1 to 41"));
        assert!(refusal(Path::new("absent.toml")).contains("cannot be read"));
    }
}
