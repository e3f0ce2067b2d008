//! The bus process; `marti run` starts it. By itself, with `--recording`, it serves the image of a recording.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use marti::processes::bus;

/// The bus of a cluster. `marti run` starts one; by itself it needs a recording.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Serve a memory with the layout and arbiter of this recording; ends when its loader leaves
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
    /// Address to listen at, of this host alone; the one it got is printed
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0", requires = "recording")]
    bind: SocketAddr,
    /// Folder for this bus' own recording, its log, and bus.token, the file with its secret
    #[arg(long, value_name = "DIR", default_value = "out/bus", requires = "recording")]
    out: PathBuf,
}

fn main() -> ExitCode {
    let Arguments { recording, bind, out } = Arguments::parse();
    let ended = match recording {
        None => bus::run(),
        Some(recording) => bus::serve_alone(&bus::Alone { recording, bind, out }).map(drop),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
