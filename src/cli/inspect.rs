//! `marti inspect SCENE`

use clap::Args;

use super::Failure;
use super::options::OctreeOptions;
use crate::topology::{Octree, SceneSource};

/// Print the database of a scene by section, and its octree by level
#[derive(Clone, Debug, Args)]
pub struct InspectArguments {
    /// An .nff or .obj file, or gears, teapot, balls, tetra, also with a size as in gears:2
    pub scene: SceneSource,
    #[command(flatten)]
    octree: OctreeOptions,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

impl InspectArguments {
    pub fn octree(&self) -> Octree {
        self.octree.octree(Octree::DEFAULT.mailbox)
    }
}

pub(super) fn inspect(arguments: &InspectArguments) -> Result<(), Failure> {
    Err(Failure::failed(format!("not built yet: inspecting {}", arguments.scene)))
}
