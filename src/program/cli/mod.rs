//! The command line of `marti`: one file a command, named like it. A command parses its arguments into a
//! plain struct, does its work by one call into the library, and prints what came of it.

pub mod check;
pub mod compare;
mod completions;
pub mod entry;
mod examples;
pub mod failure;
mod grid_options;
pub mod inspect;
pub mod keys;
mod lists;
pub mod options;
mod output_path;
mod provenance;
pub mod render;
pub mod replay;
mod report;
pub mod roles;
pub mod run;
pub mod scene;
pub mod schema;
mod similar;
pub mod study;
mod subject;
mod table;
pub mod verify;
mod view_options;
mod watertight;

use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

use clap::{ColorChoice, Parser, Subcommand};

pub use failure::{Exit, Failure};

/// Render with many processes through small local memories, and see what crosses the bus.
#[derive(Debug, Parser)]
#[command(name = "marti", bin_name = "marti", version, max_term_width = 100, arg_required_else_help = true)]
pub struct Arguments {
    // Read before the rest, by `entry`: what the command line is refused with is in colour, too.
    /// When key words are in colour; auto: on a terminal, unless NO_COLOR is set
    #[arg(long, global = true, value_enum, value_name = "WHEN", default_value_t = ColorChoice::Auto)]
    color: ColorChoice,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[command(after_help = examples::RUN)]
    Run(run::RunArguments),
    #[command(after_help = examples::RENDER)]
    Render(render::RenderArguments),
    #[command(after_help = examples::SCENE)]
    Scene(scene::SceneArguments),
    #[command(after_help = examples::INSPECT)]
    Inspect(inspect::InspectArguments),
    #[command(after_help = examples::CHECK)]
    Check(check::CheckArguments),
    #[command(after_help = examples::COMPARE)]
    Compare(compare::CompareArguments),
    #[command(after_help = examples::KEYS)]
    Keys(keys::KeysArguments),
    #[command(after_help = examples::REPLAY)]
    Replay(Box<replay::ReplayArguments>),
    #[command(after_help = examples::VERIFY)]
    Verify(verify::VerifyArguments),
    #[command(after_help = examples::STUDY)]
    Study(study::StudyArguments),
    #[command(after_help = examples::SCHEMA)]
    Schema(schema::SchemaArguments),
    #[command(after_help = examples::COMPLETIONS)]
    Completions(completions::CompletionsArguments),
    #[command(after_help = examples::MAN)]
    Man(completions::ManArguments),
    #[command(after_help = examples::NODE)]
    Node(roles::NodeArguments),
    #[command(after_help = examples::MASTER)]
    Master(roles::MasterArguments),
    #[command(after_help = examples::BUS)]
    Bus(roles::BusArguments),
    #[command(after_help = examples::DISPLAY)]
    Display(roles::DisplayArguments),
}

impl Arguments {
    /// # Errors
    /// What went wrong, and the code to exit with.
    pub fn carry_out(&self) -> Result<ExitCode, Failure> {
        let done = match &self.command {
            Command::Run(arguments) => run::run(arguments),
            Command::Render(arguments) => render::render(arguments),
            Command::Scene(arguments) => scene::scene(arguments),
            Command::Inspect(arguments) => inspect::inspect(arguments),
            Command::Check(arguments) => check::check(arguments),
            Command::Compare(arguments) => compare::compare(arguments),
            Command::Keys(arguments) => keys::keys(arguments),
            Command::Replay(arguments) => replay::replay(arguments),
            Command::Verify(arguments) => verify::verify(arguments),
            Command::Study(arguments) => study::study(arguments),
            Command::Schema(arguments) => schema::schema(arguments),
            Command::Completions(arguments) => completions::completions(arguments),
            Command::Man(arguments) => completions::man(arguments),
            Command::Node(arguments) => return Ok(arguments.play()),
            Command::Master(arguments) => return Ok(arguments.play()),
            Command::Bus(arguments) => return arguments.play(),
            Command::Display(arguments) => return Ok(arguments.play()),
        };
        done.map(|()| ExitCode::SUCCESS)
    }
}

/// Prints to standard output. A reader that has seen enough (`marti schema topology | head`) is no failure.
fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Pretty JSON with a line end.
fn json(value: &impl serde::Serialize) -> Result<String, Failure> {
    serde_json::to_string_pretty(value).map(|json| json + "\n").map_err(|error| Failure::failed(error.to_string()))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;
    use clap::error::ErrorKind;

    use super::*;

    fn parse(line: &str) -> Result<Arguments, clap::Error> {
        Arguments::try_parse_from(line.split_whitespace())
    }

    #[test]
    fn the_definition_is_sound() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn good_lines_parse() {
        for line in [
            "marti run topologies/teapot.toml",
            "marti run t.toml --out o --set cluster.nodes=9 --set cluster.local_memory.size=1/16 --aov depth,normal --quiet",
            "marti render teapot:12",
            "marti render a.nff -o a.png --size 640x480 --threads 2 --repeat 5 --depth 0 --cutoff 0.01 --aov primitive \
             --leaf-size 8 --max-depth 0 --mailbox off --report r.json",
            "marti render a.obj --camera-from -1,2,3 --camera-at=0,0,-1 --camera-up 0,0,1 --camera-angle 30 --light -1,2,3 \
             --light 1,1,1,0,0.5,1 --background 0,0,1 --up z --terminator soft --strict",
            "marti run t.toml --strict",
            "marti check t.toml --strict",
            "marti compare out/a out/b -o d.png --format json --exit-code",
            "marti scene gears --size 4 -o gears4.nff",
            "marti inspect gears:2 --leaf-size 8 --max-depth 9 --json --database gears.db",
            "marti check t.toml --set scene.file=a.nff",
            "marti keys new k --days 7",
            "marti keys show k",
            "marti keys rotate k --authority",
            "marti verify teapot:12 --rays 1000 --seed 7 --scale 1e-12 --translate -1e6 --json",
            "marti verify --watertight --rays 1000000000 --seed 2",
            "marti schema topology",
            "marti run t.toml --record references",
            "marti run t.toml --chaos random(3)",
            "marti replay out/t",
            "marti replay out/t --local-memory 1/32..1/4,all --line 16..256 --ways 1..8,full --replacement lru,optimal \
             --nodes 1..64x2 --clusters 1,2 --tile-order morton --assignment on-demand --bus-width 1..64 \
             --arbiter fifo,round_robin:4 --timings --classes --format csv --partial",
            "marti replay out/t --curve --verify",
            "marti replay out/t --contention --nodes 1..64x2 --format json",
            "marti replay out/t --origins --color never",
            "marti --color always replay out/t --output a.din --export din --node 0",
            "marti render gears --output a.png --format json",
            "marti scene gears --output a.nff",
            "marti check t.toml --format json",
            "marti verify gears -q",
            "marti verify gears --format csv",
            "marti inspect gears --format json",
            "marti replay out/t --assignment on_demand --arbiter round-robin:4,fixed-priority --replacement s3_fifo -q",
            "marti replay out/t --heat-map misses -o m.png",
            "marti replay out/t --export oracle-general --node 0 -o t.oracleGeneral",
            "marti replay t.oracleGeneral --local-memory 4096",
            "marti replay out/t --to-bus 127.0.0.1:1 --token bus.token --pace recorded",
            "marti study paper --format json --out o -q",
            "marti study sweep t.toml --set a.b=1 --local-memory 1/32..1/4 --line 16,64 --nodes 4,9 --timings --format csv",
        ] {
            assert!(parse(line).is_ok(), "{line}: {}", parse(line).expect_err("refused"));
        }
    }

    #[test]
    fn bad_lines_are_refused_with_what_was_expected() {
        for (line, told) in [
            ("marti walk", "unrecognized subcommand 'walk'"),
            ("marti run", "<TOPOLOGY>"),
            ("marti run t.toml --set cluster.nodes", "expected KEY=VALUE"),
            ("marti run t.toml --nodes 9", "expected --set cluster.nodes=9"),
            ("marti run t.toml --size 64x64", "expected --set image.width=640"),
            ("marti render a.obj --camera-from 1,2", "expected three numbers"),
            ("marti run t.toml --set =1", "expected names joined by dots"),
            ("marti run t.toml --aov colour", "possible values: depth, normal, primitive"),
            ("marti render teapots", "or gears, teapot, balls, tetra, slivers, plane, decades, giant or corner"),
            ("marti render gears:0", "expected a size from 1 to 41"),
            ("marti render gears:x", "expected an integer from 1 to 41"),
            ("marti render a.nff --size 640", "expected WIDTHxHEIGHT"),
            ("marti render a.nff --size 640x0", "each from 1 to 65536"),
            ("marti render a.nff --size 70000x1", "each from 1 to 65536"),
            ("marti render a.nff -o a.jpg", "expected a name ending in .png"),
            ("marti render a.nff -o .png", "expected a name ending in .png"),
            ("marti render a.nff --threads 0", "0 is not in 1..=1024"),
            ("marti render a.nff --repeat x", "invalid digit"),
            ("marti render a.nff --depth 65", "expected an integer from 0 to 64"),
            ("marti render a.nff --cutoff nan", "expected a number from 0 to 1"),
            ("marti render a.nff --leaf-size 0", "expected an integer from 1 to 1024"),
            ("marti render a.nff --max-depth 21", "expected an integer from 0 to 20"),
            ("marti render a.nff --mailbox maybe", "possible values: on, off"),
            ("marti keys new", "<FOLDER>"),
            ("marti keys new k --days 0", "0 is not in 1..=36500"),
            ("marti render a.nff b.nff", "unexpected argument 'b.nff'"),
            ("marti verify", "<SCENE>"),
            ("marti verify gears --watertight", "cannot be used with"),
            ("marti verify gears --scale 0", "expected a positive number"),
            ("marti verify gears --translate inf", "expected a finite number"),
            ("marti scene torus", "expected gears, teapot, balls, tetra, slivers, plane, decades, giant or corner"),
            ("marti scene gears --size -1", "unexpected argument"),
            ("marti run t.toml --record misses", "possible values: references"),
            ("marti run --resume o --force", "cannot be used with"),
            ("marti run t.toml --chaos kill", "column 5: expected bus, master, node or display"),
            ("marti replay", "<RECORDING>"),
            ("marti replay o --local-memory 9/8", "a share of the database above 0"),
            ("marti replay o --local-memory 1/8..4096", "is empty"),
            ("marti replay o --line 20", "power of two"),
            ("marti replay o --ways 0", "or full for all lines"),
            (
                "marti replay o --replacement mru",
                "possible values: lru, fifo, clock, clock:0, random, srrip, sieve, s3-fifo, plru, optimal",
            ),
            ("marti replay o --nodes 4..2", "expected the smaller value first"),
            ("marti replay o --nodes 1..300", "expected an integer from 1 to 256"),
            ("marti replay o --tile-order spiral", "expected scanline, morton or random"),
            ("marti replay o --arbiter round_robin:0", "expected an integer from 1 to 1024"),
            ("marti replay o --bus-width 3", "power of two"),
            ("marti replay o --export din", "--out <FILE>"),
            ("marti replay o --heat-map misses", "--out <FILE>"),
            ("marti replay o --curve --origins", "cannot be used with"),
            ("marti replay o --to-bus 127.0.0.1:1", "--token <FILE>"),
            ("marti study", "paper"),
            ("marti study paper --format xml", "possible values: text, json, csv"),
            ("marti study sweep t.toml --nodes 0", "expected an integer from 1 to 256"),
            ("marti verify gears --json --format text", "cannot be used with"),
            ("marti run t.toml -q --format json", "cannot be used with"),
            ("marti --color red check t.toml", "possible values: auto, always, never"),
            ("marti schema recording", "possible values: topology, report"),
        ] {
            let error = parse(line).expect_err(line);
            assert_eq!(error.exit_code(), 2, "{line}");
            assert!(error.to_string().contains(told), "{line}: {error}");
        }
    }

    #[test]
    fn help_is_no_failure() {
        for line in ["marti --help", "marti help run", "marti render -h"] {
            let answer = parse(line).expect_err(line);
            assert_eq!((answer.kind(), answer.exit_code()), (ErrorKind::DisplayHelp, 0));
        }
    }

    #[test]
    fn exr_is_an_option_of_builds_that_have_it() {
        let has = trace::image_file::EXR_SUPPORTED;
        assert_eq!(parse("marti run t.toml --exr").is_ok(), has);
        assert_eq!(parse("marti render a.nff --exr").is_ok(), has);
    }
}
