//! `marti scene KIND`

use std::path::PathBuf;

use clap::Args;

use super::{Failure, output_path};
use trace::scene::procedural::{self, Board, Kind, WriteError};

/// Write a procedural scene as an NFF file
#[derive(Clone, Debug, Args)]
pub struct SceneArguments {
    /// gears, teapot, balls, tetra, slivers, plane, decades, giant or corner
    pub kind: Kind,
    /// Size factor, how finely or how often the scene is divided [default: its kind's]
    #[arg(long, value_name = "N")]
    pub size: Option<u32>,
    /// What a teapot stands on [default: squares]
    #[arg(long, value_name = "squares|none")]
    pub board: Option<Board>,
    /// File to write [default: standard output]
    #[arg(long, short, alias = "output", value_name = "FILE.nff")]
    pub out: Option<PathBuf>,
}

pub(super) fn scene(arguments: &SceneArguments) -> Result<(), Failure> {
    arguments.out.iter().try_for_each(|file| output_path::check(file))?;
    let SceneArguments { kind, size, board, out } = arguments;
    procedural::write(*kind, *size, *board, out.as_deref()).map_err(|error| match error {
        WriteError::Size(error) => Failure::bad_input(error.to_string()),
        WriteError::Board(error) => Failure::bad_input(format!("--board: {error}")),
        WriteError::Io(error) => Failure::failed(error.to_string()),
    })
}
