//! `marti replay RECORDING --to-bus ADDRESS`: the recorded traffic once more, to a running bus.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use crate::cli::table::Format;
use crate::cli::{Exit, Failure, json, print};
use cluster::processes::player::{self, Pace, PlayRequest};
use machine::recording::references::Sidecar;

#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Live replay")]
pub(super) struct ToBus {
    /// Send the recorded traffic to the bus at this address, one that `marti-bus --recording` printed
    #[arg(long, value_name = "ADDRESS", group = "mode", requires = "token")]
    to_bus: Option<SocketAddr>,
    /// The file with that bus's token
    #[arg(long, value_name = "FILE")]
    token: Option<PathBuf>,
    /// How fast requests follow one another
    #[arg(long, value_enum, default_value_t = PaceName::Fastest)]
    pace: PaceName,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
enum PaceName {
    /// As they were recorded
    Recorded,
    /// As soon as the one before is answered
    Fastest,
}

impl ToBus {
    pub(super) fn is_asked(&self) -> bool {
        self.to_bus.is_some()
    }

    pub(super) fn play(&self, recording: &Path, may_be_damaged: bool, format: Format) -> Result<(), Failure> {
        let (Some(bus), Some(token)) = (self.to_bus, self.token.clone()) else {
            return Err(Failure::bad_input("expected --to-bus and --token"));
        };
        let pace = match self.pace {
            PaceName::Recorded => Pace::Recorded,
            PaceName::Fastest => Pace::Fastest,
        };
        // A run that recorded no references has no sidecar, and its image is known by its answers alone.
        let scene_sha256 = Sidecar::read(&recording.join("recording")).ok().map(|(sidecar, _)| sidecar.scene_sha256);
        let request = PlayRequest { recording: recording.to_owned(), bus, token, pace, scene_sha256, may_be_damaged };
        let outcome = player::play(&request).map_err(|error| {
            let exit = if error.is_bad_input() { Exit::BadInput } else { Exit::Failed };
            Failure::new(exit, error.to_string())
        })?;
        match format {
            Format::Text => print(&outcome.text())?,
            Format::Json | Format::Csv => print(&json(&outcome)?)?,
        }
        match outcome.mismatches {
            0 => Ok(()),
            mismatches => Err(Failure::failed(format!("{mismatches} answers are not the recorded ones"))),
        }
    }
}
