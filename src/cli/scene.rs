//! `marti scene gears|teapot|balls|tetra`

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use crate::scene::procedural::Kind;
use crate::topology::value::ProceduralSize;
use crate::topology::{SceneSource, parse_kind};

/// Write a procedural scene as an NFF file
#[derive(Clone, Debug, Args)]
pub struct SceneArguments {
    /// gears, teapot, balls or tetra
    #[arg(value_parser = parse_kind)]
    pub kind: Kind,
    /// Size factor, how finely or how often the scene is divided [default: its kind's]
    #[arg(long, value_name = "N")]
    pub size: Option<ProceduralSize>,
    /// File to write [default: standard output]
    #[arg(long, short, value_name = "FILE.nff")]
    pub output: Option<PathBuf>,
}

pub(super) fn scene(arguments: &SceneArguments) -> Result<(), Failure> {
    let source = SceneSource::procedural(arguments.kind, arguments.size).map_err(Failure::bad_input)?;
    Err(Failure::failed(format!("not built yet: writing {source}")))
}
