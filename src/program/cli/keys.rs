//! `marti keys new|show|rotate DIR`: the identity of a cluster.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::{Failure, print};
use cluster::keys::{KeyFolder, KeysError, Validity};

/// Make, show or renew the keys by which processes on several hosts know each other (docs/security.md)
#[derive(Clone, Debug, Args)]
pub struct KeysArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Clone, Debug, Subcommand)]
enum Command {
    /// Make an authority, and a certificate and key for each role
    New(NewArguments),
    /// Show the authority's fingerprint, and until when each certificate holds
    Show(ShowArguments),
    /// Make new certificates and keys under the same authority
    Rotate(RotateArguments),
}

#[derive(Clone, Debug, Args)]
struct NewArguments {
    /// The folder, made if need be
    folder: PathBuf,
    #[command(flatten)]
    validity: ValidityArguments,
}

#[derive(Clone, Debug, Args)]
struct ShowArguments {
    /// The folder that `marti keys new` made
    folder: PathBuf,
}

#[derive(Clone, Debug, Args)]
struct RotateArguments {
    /// The folder that `marti keys new` made
    folder: PathBuf,
    /// Make a new authority too: nothing that the old one signed is accepted any more
    #[arg(long)]
    authority: bool,
    #[command(flatten)]
    validity: ValidityArguments,
}

#[derive(Clone, Copy, Debug, Args)]
struct ValidityArguments {
    /// How long the certificates hold
    #[arg(long, value_name = "N", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=36500))]
    days: u32,
}

pub(super) fn keys(arguments: &KeysArguments) -> Result<(), Failure> {
    match &arguments.command {
        Command::New(NewArguments { folder, validity }) => {
            KeyFolder::at(folder).create(Validity::days(validity.days)).map_err(failure)?;
            show(folder)
        }
        Command::Show(ShowArguments { folder }) => show(folder),
        Command::Rotate(RotateArguments { folder, authority, validity }) => {
            let (keys, validity) = (KeyFolder::at(folder), Validity::days(validity.days));
            if *authority { keys.rotate_authority(validity) } else { keys.rotate(validity) }.map_err(failure)?;
            show(folder)
        }
    }
}

fn show(folder: &Path) -> Result<(), Failure> {
    let shown = KeyFolder::at(folder).show().map_err(failure)?;
    let mut text = format!("authority  sha256 {}\n", shown.authority);
    let (mut unusable, all) = (0, shown.roles.len());
    for (kind, day) in shown.roles {
        // Writing to a string cannot fail.
        let _ = match day {
            Ok(day) => writeln!(text, "{:<10} until {day}", kind.name()),
            Err(error) => {
                unusable += 1;
                writeln!(text, "{:<10} unusable: {error}", kind.name())
            }
        };
    }
    print(&text)?;
    if unusable > 0 {
        return Err(Failure::bad_input(format!("{unusable} of {all} certificates cannot be used")));
    }
    Ok(())
}

fn failure(error: KeysError) -> Failure {
    match error {
        KeysError::Make(_) => Failure::failed(error.to_string()),
        _ => Failure::bad_input(error.to_string()),
    }
}
