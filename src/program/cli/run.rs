//! `marti run TOPOLOGY`, and `marti run --resume OUT`

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use super::options::{OutputOptions, TextOrJson};
use super::report::print_report;
use super::{Exit, Failure, print, subject};
use cluster::chaos::FaultSchedule;
use cluster::processes::manager::{self, Interrupt, RunEnd, RunRequest};
use cluster::topology::{Override, Topology};
use ground::outlet;

/// Render a topology with all its processes
#[derive(Clone, Debug, Args)]
pub struct RunArguments {
    /// Topology file (docs/topology.md); or a scene by itself, an .nff or .obj file or one such as gears:2: four nodes render it
    /// that have all of it
    #[arg(required_unless_present = "resume")]
    pub topology: Option<PathBuf>,
    /// Folder for the image, the report and the recording [default: out/NAME/ for NAME.toml]; what an earlier run left
    /// there is moved to DIR/earlier/N
    #[arg(long, short, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Go on with the run that was interrupted in this folder: with its topology, and the tiles that it had
    #[arg(long, value_name = "DIR", conflicts_with_all = ["topology", "out"])]
    pub resume: Option<PathBuf>,
    /// Use the folder though it holds files that no run wrote; those that are in the way are moved to DIR/earlier/N
    #[arg(long, conflicts_with = "resume")]
    pub force: bool,
    /// Warnings about the scene are errors: nothing is started
    #[arg(long)]
    pub strict: bool,
    /// Set a key of the topology for this run, such as cluster.nodes=9
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<Override>,
    #[command(flatten)]
    pub output: OutputOptions,
    /// What to record besides the bus: references, which `marti replay` puts through other memories
    #[arg(long, value_name = "WHAT", value_enum, conflicts_with = "resume")]
    pub record: Option<Record>,
    /// Listen at this address for processes that join, instead of where the topology's first host says
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub listen: Option<SocketAddr>,
    /// Folder of the cluster's keys, which `marti keys new` makes: processes prove who they are, and all is encrypted
    #[arg(long, value_name = "DIR", env = "MARTI_KEYS")]
    pub keys: Option<PathBuf>,
    /// Use addresses that other machines can reach without keys: anybody there can read and disturb the run
    #[arg(long)]
    pub insecure: bool,
    /// Faults on purpose, such as "kill node@10%; cut node 3@50% for 5s" (docs/chaos.md)
    #[arg(long, value_name = "FAULTS")]
    pub chaos: Option<FaultSchedule>,
    /// Serve /healthz (whether the run is ready) and /metrics (its progress) on this loopback address
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub health: Option<SocketAddr>,
    /// How the summary is printed; as JSON it is the whole report (docs/report.md)
    #[arg(long, value_enum, default_value_t = TextOrJson::Text, conflicts_with = "quiet")]
    format: TextOrJson,
    /// Print no progress and no summary
    #[arg(long, short)]
    pub quiet: bool,
    /// A key of the topology, for those who look for an option
    #[arg(long, hide = true, value_parser = |_: &str| Err::<String, _>("expected --set cluster.nodes=9"))]
    nodes: Option<String>,
    /// A key of the topology, for those who look for an option
    #[arg(long, hide = true, value_parser = |_: &str| Err::<String, _>("expected --set image.width=640 --set image.height=480"))]
    size: Option<String>,
}

/// What can be recorded.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub enum Record {
    /// Every record that a node reads, before its local memory sees it
    References,
}

impl RunArguments {
    /// The topology and the folder that the run writes into.
    fn subject(&self) -> Result<(Topology, PathBuf), Failure> {
        let (topology, out) = match (&self.topology, &self.resume) {
            (Some(name), _) => (subject::topology(name, &self.set)?, self.out.clone()),
            (None, Some(folder)) => {
                (Topology::read(&manager::resolved_topology(folder), &self.set)?, Some(folder.clone()))
            }
            (None, None) => return Err(Failure::new(Exit::BadInput, "no topology is given")),
        };
        let out = out.unwrap_or_else(|| PathBuf::from("out").join(&topology.name));
        Ok((topology, out))
    }
}

pub(super) fn run(arguments: &RunArguments) -> Result<(), Failure> {
    let (topology, out) = arguments.subject()?;
    // With other settings there may be something left to do.
    let output = &arguments.output;
    let asks_for_more = !arguments.set.is_empty()
        || !output.aov().is_empty()
        || output.exr()
        || arguments.chaos.is_some()
        || arguments.health.is_some()
        || arguments.listen.is_some();
    if arguments.resume.is_some()
        && !asks_for_more
        && let Some(report) = manager::finished(&out)
    {
        if !arguments.quiet {
            if arguments.format == TextOrJson::Text {
                print(&format!("{}: the run is finished, nothing was rendered; its summary:\n", out.display()))?;
            }
            print_report(&report, arguments.format)?;
        }
        return Ok(());
    }
    if arguments.resume.is_some() && out.join("recording/references.json").exists() {
        outlet::say("note: a resumed run records no references; those of the first part are put aside in earlier");
    }
    let idle = topology.without_effect_live();
    if !idle.is_empty() && !arguments.quiet {
        outlet::say(format_args!(
            "note: {} change nothing of a live run, only of replays and studies",
            idle.join(", ")
        ));
    }
    let outcome = manager::run(RunRequest {
        out,
        resume: arguments.resume.is_some(),
        force: arguments.force,
        strict: arguments.strict,
        topology,
        aov: arguments.output.aov(),
        exr: arguments.output.exr(),
        record_references: arguments.record == Some(Record::References),
        listen: arguments.listen,
        keys: arguments.keys.clone(),
        insecure: arguments.insecure,
        chaos: arguments.chaos.clone(),
        health: arguments.health,
        quiet: arguments.quiet,
    })
    .map_err(|error| {
        let exit = if error.is_bad_input() { Exit::BadInput } else { Exit::Failed };
        Failure::new(exit, error.to_string())
    })?;
    let printed = if arguments.quiet { Ok(()) } else { print_report(&outcome.report, arguments.format) };
    match outcome.end {
        RunEnd::Done => printed,
        RunEnd::Failed(why) => Err(Failure::failed(why)),
        RunEnd::TilesMissing => Err(Failure::new(Exit::TilesMissing, "tiles are missing: no node is left")),
        RunEnd::Interrupted(interrupt) => {
            let (exit, what) = match interrupt {
                Interrupt::Sigint => (Exit::Interrupted, "interrupted"),
                Interrupt::Sigterm => (Exit::Terminated, "terminated"),
                Interrupt::Sighup => (Exit::HungUp, "the terminal was closed"),
            };
            let out = outcome.out.display();
            Err(Failure::new(exit, format!("{what}; `marti run --resume {out}` goes on with it")))
        }
    }
}
