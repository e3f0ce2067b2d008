//! The topology of a scene alone: four nodes, each with all of the database.

use std::path::Path;

use super::file::{Cluster, File, Header, LocalMemory, Scene};
use super::prove::is_folders_name;
use super::value::{ProceduralSize, Size};
use super::{Override, Topology};
use machine::hardware::specification::MemorySize;
use trace::scene::procedural::Board;
use trace::scene::source::Source;
use trace::scene::{SceneSource, SourceError};

impl Topology {
    /// Renders a scene as fast as processes can, but for the overrides: nothing is simulated.
    ///
    /// # Errors
    /// What is wrong with an override.
    pub fn of_scene(scene: &SceneSource, overrides: &[Override]) -> Result<Self, SourceError> {
        let name = Some(scene.name()).filter(|name| is_folders_name(name)).unwrap_or_else(|| "scene".to_owned());
        let written = File {
            topology: Header { name: Some(name), ..Header::default() },
            scene: match scene {
                SceneSource::File(path) => Scene { file: Some(name_of(path)), ..Scene::default() },
                SceneSource::Procedural(procedural) => Scene {
                    procedural: Some(procedural.kind),
                    size: Some(ProceduralSize(procedural.size)),
                    board: Some(procedural.board).filter(|board| *board != Board::Squares),
                    ..Scene::default()
                },
            },
            cluster: Cluster {
                local_memory: LocalMemory { size: Size(MemorySize::All), ..LocalMemory::default() },
                ..Cluster::default()
            },
            ..File::default()
        };
        let text = toml::to_string(&written)
            .map_err(|error| SourceError::new(Path::new(&scene.to_string()), None, error.to_string()))?;
        // The scene is found from the folder of what names it.
        Self::from_source(&Source::from_bytes(&scene.to_string(), text.as_bytes()), overrides)
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::topology::value::Nodes;
    use trace::picture::Terminator;

    #[test]
    fn a_scene_is_rendered_by_four_nodes_with_all_of_it() {
        for (scene, name) in [
            ("gears:2", "gears"),
            ("scenes/house.obj", "house"),
            ("../a b.nff", "a b"),
            ("teapot", "teapot"),
            ("teapot:3:no-board", "teapot"),
            ("..nff", "scene"),
        ] {
            let source: SceneSource = scene.parse().expect(scene);
            let topology = Topology::of_scene(&source, &[]).expect(scene);
            assert_eq!((topology.name.as_str(), &topology.scene), (name, &source));
            assert_eq!(
                (Nodes(topology.cluster.nodes), topology.cluster.local_memory.size),
                (Nodes(4), MemorySize::All)
            );
        }
    }

    #[test]
    fn its_keys_can_be_set() {
        let sets = ["cluster.nodes=2", "cluster.local_memory.size=1/8", "image.terminator=soft"];
        let sets = sets.map(|set| set.parse().expect("an override"));
        let topology = Topology::of_scene(&"gears:2".parse().expect("a scene"), &sets).expect("possible");
        assert_eq!(topology.cluster.nodes, 2);
        assert_eq!(topology.cluster.local_memory.size, MemorySize::Share { numerator: 1, denominator: 8 });
        assert_eq!(topology.image.terminator, Some(Terminator::Soft));
        let wrong = "cluster.nodes=0".parse().expect("an override");
        let error = Topology::of_scene(&"gears:2".parse().expect("a scene"), &[wrong]).expect_err("no nodes");
        assert_eq!(error.to_string(), "--set cluster.nodes=0: cluster.nodes is 0, expected an integer from 1 to 256");
    }
}
