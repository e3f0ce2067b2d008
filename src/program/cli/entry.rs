//! How the program begins, and how the processes go on that `marti run` starts, or that join it.

use std::env;
use std::ffi::CString;
use std::fmt::Display;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, CommandFactory, Error, FromArgMatches};
use nix::sys::prctl;
use nix::sys::signal::{SigHandler, Signal, signal};

use super::{Failure, similar};
use cluster::processes::join::{self, Joining};
use cluster::processes::{Child, Origin};
use cluster::protocol::hello::Role;
use cluster::topology::value::Seconds;
use ground::colour::{self, Choice};
use ground::floating_point;
use trace::image_file;
use trace::tracer::simd::Simd;

/// What the program does first and last. A file-size limit becomes an error of the write that exceeds it (EFBIG) instead of
/// the process's death, and a floating-point environment that could change the image is refused with exit code 1.
pub fn enter(play: impl FnOnce() -> Result<ExitCode, Failure>) -> ExitCode {
    // SAFETY: an ignored signal runs no handler.
    let ignored = unsafe { signal(Signal::SIGXFSZ, SigHandler::SigIgn) };
    let ready = ignored.map_err(|error| Failure::failed(format!("cannot ignore SIGXFSZ: {error}"))).and_then(|_| {
        floating_point::check().map_err(|unusual| {
            Failure::failed(format!(
                "the floating-point environment is not the default one: {unusual}; expected that of a process to which \
                 no library (LD_PRELOAD?) has done anything"
            ))
        })
    });
    ready.and_then(|()| play()).unwrap_or_else(|failure| failure.report())
}

/// Options of a process that joins; `marti run` gives none.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Joining a run")]
pub struct JoinArguments {
    /// Join the run of this manager; asks until a slot is free
    #[arg(long, value_name = "HOST:PORT", env = "MARTI_JOIN", value_parser = manager)]
    join: Option<(String, u16)>,
    /// Address to listen at [default: the interface by which it reaches the manager]
    #[arg(long, value_name = "ADDRESS", env = "MARTI_BIND")]
    interface: Option<IpAddr>,
    /// Address or name by which other processes reach this one [default: where it listens]
    #[arg(long, value_name = "NAME", env = "MARTI_ADVERTISE")]
    advertise: Option<String>,
    /// Only take a slot on this host of the topology
    #[arg(long, value_name = "NAME", env = "MARTI_HOST")]
    host: Option<String>,
    /// Folder of keys that `marti keys new` made, or the file of this role
    #[arg(long, value_name = "DIR", env = "MARTI_KEYS")]
    keys: Option<PathBuf>,
    /// File of the run's token, OUT/join.token, where there are no keys
    #[arg(long, value_name = "FILE", env = "MARTI_TOKEN")]
    token: Option<PathBuf>,
    /// How long to ask for a slot
    #[arg(long, value_name = "SECONDS", env = "MARTI_PATIENCE", default_value_t = Seconds(600.0))]
    patience: Seconds,
    /// Serve /healthz on this loopback address: whether it has a slot
    #[arg(long, value_name = "ADDRESS:PORT")]
    health: Option<SocketAddr>,
}

/// Options of [`JoinArguments`] that have no effect without `--join`. The environment may have them: processes that `marti run`
/// starts inherit it.
const OF_JOINING: [&str; 8] = ["interface", "advertise", "host", "keys", "token", "patience", "health", "threads"];

/// Reads the command line of a program of this version. Ends the process where it cannot be read, and where an option of joining would have no effect.
pub fn parse<A: CommandFactory + FromArgMatches>(version: &'static str) -> A {
    colour::choose(wanted_colours());
    let mut command = A::command().version(version).long_version(long_version(version));
    let matches = command.try_get_matches_from_mut(env::args_os()).unwrap_or_else(|error| {
        let error = similar::with_commands(error, &command);
        error.exit()
    });
    if let Some((name, arguments)) = matches.subcommand()
        && let Some(subcommand) = command.find_subcommand_mut(name)
        && has(subcommand, "join")
        && let Err(error) = check_joining(subcommand, arguments)
    {
        error.format(subcommand).exit()
    }
    A::from_arg_matches(&matches).unwrap_or_else(|error| error.format(&mut command).exit())
}

fn has(command: &Command, option: &str) -> bool {
    command.get_arguments().any(|argument| argument.get_id() == option)
}

/// What `--color` says, known before the command line is read as a whole.
fn wanted_colours() -> Choice {
    let typed: Vec<String> = env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let value = typed.iter().enumerate().find_map(|(i, word)| match word.strip_prefix("--color")? {
        "" => typed.get(i + 1).map(String::as_str),
        value => value.strip_prefix('='),
    });
    match value {
        Some("always") => Choice::Always,
        Some("never") => Choice::Never,
        _ => Choice::Auto,
    }
}

/// The version, and what of this build and this processor decides how fast it is.
fn long_version(version: &str) -> String {
    let available = Simd::ALL.into_iter().filter(|simd| simd.is_available()).map(Simd::name).collect::<Vec<_>>();
    let exr = if image_file::EXR_SUPPORTED { "yes" } else { "no" };
    format!("{version}\nvector instructions: {}\nOpenEXR output: {exr}", available.join(", "))
}

fn check_joining(command: &Command, matches: &ArgMatches) -> Result<(), Error> {
    let is_typed =
        |option: &&str| has(command, option) && matches.value_source(option) == Some(ValueSource::CommandLine);
    let refused = |kind, what: String| Err(Error::raw(kind, what));
    if !matches.contains_id("join")
        && let Some(option) = OF_JOINING.iter().find(|option| is_typed(option))
    {
        let what = format!("--{option} has no effect without --join, expected both or neither\n");
        return refused(ErrorKind::MissingRequiredArgument, what);
    }
    if ["keys", "token"].iter().all(is_typed) {
        let what = "--token has no effect beside --keys, expected one of them\n";
        return refused(ErrorKind::ArgumentConflict, what.to_owned());
    }
    Ok(())
}

/// Gives this process its role's name, by which `ps` and `pgrep` find it.
pub(super) fn name_process(program: &str) {
    // The name of Linux has 15 bytes at most, and it is for people alone: a failure changes nothing.
    let _ = CString::new(program).map(|name| prctl::set_name(&name));
}

impl JoinArguments {
    pub(super) fn joins(&self) -> bool {
        self.join.is_some()
    }

    fn origin(&self) -> Origin {
        let Self { join, interface, advertise, host, keys, token, patience, health } = self.clone();
        let Some((manager, port)) = join else { return Origin::Spawned };
        Origin::Joining(Box::new(Joining {
            manager,
            port,
            token,
            keys,
            host,
            bind: interface,
            advertise,
            patience: Duration::from_secs_f64(patience.0),
            health,
        }))
    }

    /// Plays a role from start to end. A process that joined begins anew when its run has failed under it.
    pub fn play<E: Display>(
        &self,
        program: &'static str,
        role: Role,
        run: impl FnOnce(&Child) -> Result<(), E>,
    ) -> ExitCode {
        let failed = |error: &dyn Display| Failure::failed(error.to_string()).report();
        name_process(program);
        let child = match Child::start(program, role, &self.origin()) {
            Ok(child) => child,
            Err(error) => return failed(&error),
        };
        match run(&child) {
            Ok(()) => ExitCode::SUCCESS,
            // The manager is gone too, where a whole cluster is asked to go.
            Err(error) if child.is_leaving() => {
                tracing::warn!("left: {error}");
                ExitCode::SUCCESS
            }
            Err(error) => {
                if child.joined {
                    tracing::error!("{error}");
                    join::begin_anew();
                }
                failed(&error)
            }
        }
    }
}

fn manager(text: &str) -> Result<(String, u16), String> {
    let parts = text.rsplit_once(':').and_then(|(host, port)| Some((host, port.parse::<u16>().ok()?)));
    match parts {
        Some((host, port)) if !host.is_empty() && port > 0 => {
            Ok((host.trim_start_matches('[').trim_end_matches(']').to_owned(), port))
        }
        _ => Err("expected HOST:PORT such as manager.example:4242".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manager_is_a_host_and_a_port() {
        assert_eq!(manager("m.example:4242"), Ok(("m.example".to_owned(), 4242)));
        assert_eq!(manager("[::1]:80"), Ok(("::1".to_owned(), 80)));
        for text in ["", "m", "m:", ":80", "m:0", "m:65536", "m:x"] {
            assert!(manager(text).is_err(), "{text}");
        }
    }
}
