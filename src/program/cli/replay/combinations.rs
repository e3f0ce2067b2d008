//! Which option of `marti replay` combines with which: one table, for parsing, help and docs.

use std::fmt::Write;

use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, Error, FromArgMatches};

use crate::cli::Failure;

/// What a command answers; an option of the same name asks for it, but for [`Self::Counts`].
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Question {
    Counts,
    Curve,
    Contention,
    Origins,
    HeatMap,
    /// Line references of one memory: `din`, `oracle-general`.
    ExportLines,
    /// Record reads: `csv`, `json`.
    ExportReads,
    /// A simulated bus: `chrome`, `vcd`.
    ExportBus,
    ToBus,
}

impl Question {
    const ALL: [Self; 9] = [
        Self::Counts,
        Self::Curve,
        Self::Contention,
        Self::Origins,
        Self::HeatMap,
        Self::ExportLines,
        Self::ExportReads,
        Self::ExportBus,
        Self::ToBus,
    ];

    /// The head of its column in the table.
    #[cfg(test)]
    fn head(self) -> &'static str {
        match self {
            Self::Counts => "counts",
            Self::Curve => "curve",
            Self::Contention => "contention",
            Self::Origins => "origins",
            Self::HeatMap => "heat-map",
            Self::ExportLines => "din, oracle-general",
            Self::ExportReads => "csv, json",
            Self::ExportBus => "chrome, vcd",
            Self::ToBus => "to-bus",
        }
    }

    /// As it is typed.
    fn typed(self) -> &'static str {
        match self {
            Self::Counts => "a table of counts",
            Self::Curve => "--curve",
            Self::Contention => "--contention",
            Self::Origins => "--origins",
            Self::HeatMap => "--heat-map",
            Self::ExportLines => "--export din or oracle-general",
            Self::ExportReads => "--export csv or json",
            Self::ExportBus => "--export chrome or vcd",
            Self::ToBus => "--to-bus",
        }
    }
}

/// How many values of an option a question takes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Takes {
    /// It would have no effect.
    Nothing,
    One,
    List,
}
use Takes::{List, Nothing, One};

/// What can be replayed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Subject {
    Recording,
    /// A trace that came from elsewhere.
    Trace,
}

struct Rule {
    /// Without its dashes.
    option: &'static str,
    /// By question, in the order of [`Question::ALL`].
    takes: [Takes; Question::ALL.len()],
    /// Whether it has an effect on a recording, and on a trace.
    of: [bool; 2],
}

const BOTH: [bool; 2] = [true, true];
const RECORDING: [bool; 2] = [true, false];
const TRACE: [bool; 2] = [false, true];

/// How a trace is read.
const INPUT: [Takes; 9] = [One, One, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing];
/// How a memory writes.
const WRITING: [Takes; 9] = [One, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing];

const fn rule(option: &'static str, takes: [Takes; Question::ALL.len()], of: [bool; 2]) -> Rule {
    Rule { option, takes, of }
}

/// What decides what a memory misses.
const MEMORY: [Takes; 9] = [List, Nothing, One, One, One, Nothing, Nothing, One, Nothing];
/// What decides what a node reads.
const TILES: [Takes; 9] = [List, List, One, One, One, One, One, One, Nothing];
/// What decides times alone.
const TIMES: [Takes; 9] = [List, Nothing, One, Nothing, Nothing, Nothing, Nothing, One, Nothing];

#[rustfmt::skip]
const RULES: [Rule; 37] = [
    rule("local-memory", MEMORY, BOTH),
    rule("line", [List, List, One, One, One, One, Nothing, One, Nothing], BOTH),
    rule("ways", MEMORY, BOTH),
    rule("replacement", MEMORY, BOTH),
    rule("nodes", [List, List, List, One, One, One, One, One, Nothing], RECORDING),
    rule("clusters", TILES, RECORDING),
    rule("tile-order", TILES, RECORDING),
    rule("assignment", TILES, RECORDING),
    rule("bus-width", TIMES, RECORDING),
    rule("arbiter", TIMES, RECORDING),
    rule("transactions", TIMES, RECORDING),
    rule("latency", TIMES, RECORDING),
    rule("cycles-per-word", TIMES, RECORDING),
    rule("octree-node", TIMES, RECORDING),
    rule("primitive-test", TIMES, RECORDING),
    rule("shading", TIMES, RECORDING),
    rule("local-access", TIMES, RECORDING),
    rule("classes", [One, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing], BOTH),
    rule("timings", [One, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing], RECORDING),
    rule("verify", [Nothing, One, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing], BOTH),
    rule("node", [Nothing, Nothing, Nothing, Nothing, Nothing, One, One, Nothing, Nothing], RECORDING),
    rule("import", INPUT, TRACE),
    rule("ignore-object-size", INPUT, TRACE),
    rule("csv-address", INPUT, TRACE),
    rule("csv-id", INPUT, TRACE),
    rule("csv-size", INPUT, TRACE),
    rule("csv-operation", INPUT, TRACE),
    rule("csv-address-unit", INPUT, TRACE),
    rule("csv-separator", INPUT, TRACE),
    rule("csv-header", INPUT, TRACE),
    rule("write-policy", WRITING, TRACE),
    rule("write-allocate", WRITING, TRACE),
    rule("format", [One, One, One, One, Nothing, Nothing, Nothing, Nothing, One], BOTH),
    rule("output", [Nothing, Nothing, Nothing, Nothing, One, One, One, One, Nothing], RECORDING),
    rule("partial", [One; 9], RECORDING),
    rule("token", [Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, One], RECORDING),
    rule("pace", [Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, Nothing, One], RECORDING),
];

/// Questions that a trace can answer: it has no tiles, rays, sections or nodes.
const OF_TRACES: [Question; 2] = [Question::Counts, Question::Curve];

/// The options that the command line has, by their names.
#[derive(Clone, Debug, Default)]
pub(super) struct Given(Vec<String>);

impl Args for Given {
    fn augment_args(command: Command) -> Command {
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        command
    }
}

impl FromArgMatches for Given {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, Error> {
        let typed = matches.ids().filter(|id| matches.value_source(id.as_str()) == Some(ValueSource::CommandLine));
        Ok(Self(typed.map(|id| id.as_str().replace('_', "-")).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Given {
    /// Whether an option of this name is there.
    pub(super) fn has(&self, option: &str) -> bool {
        self.0.iter().any(|given| given == option)
    }

    /// Refuses options that would have no effect on what is asked.
    ///
    /// # Errors
    /// The first of these, and what it has an effect on.
    pub(super) fn check(&self, question: Question, subject: Subject) -> Result<(), Failure> {
        if subject == Subject::Trace && !OF_TRACES.contains(&question) {
            let what = format!("{}: a trace has no tiles, rays or nodes, expected a recording", question.typed());
            return Err(Failure::bad_input(what));
        }
        for Rule { option, takes, of } in RULES.iter().filter(|rule| self.has(rule.option)) {
            if !of[subject as usize] {
                let (here, expected) = match subject {
                    Subject::Recording => ("a recording", "a trace that came from elsewhere"),
                    Subject::Trace => ("a trace, which is that of one node", "a recording"),
                };
                return Err(Failure::bad_input(format!("--{option} has no effect on {here}, expected {expected}")));
            }
            if takes[question as usize] == Nothing {
                let others = Question::ALL.iter().filter(|other| takes[**other as usize] != Nothing);
                let others: Vec<_> = others.map(|other| other.typed()).collect();
                let what =
                    format!("--{option} has no effect on {}, expected it with {}", question.typed(), one_of(&others));
                return Err(Failure::bad_input(what));
            }
        }
        Ok(())
    }
}

fn one_of(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).to_owned(),
        [first @ .., last] => format!("{} or {last}", first.join(", ")),
    }
}

/// Whether an option has an effect on a trace, or on nothing else.
fn of_trace(of: [bool; 2]) -> &'static str {
    match of {
        [false, true] => "only",
        [_, true] => "yes",
        [_, false] => "",
    }
}

/// The table of docs/replay.md.
#[cfg(test)]
fn table() -> String {
    let heads = Question::ALL.map(Question::head);
    let mut out = format!("| option | {} | trace |\n|---{}|---|\n", heads.join(" | "), "|---".repeat(heads.len()));
    for Rule { option, takes, of } in &RULES {
        let cell = |takes: &Takes| match takes {
            Nothing => "",
            One => "one",
            List => "list",
        };
        let cells = takes.iter().map(cell).collect::<Vec<_>>().join(" | ");
        let _ = writeln!(out, "| `--{option}` | {cells} | {} |", of_trace(*of));
    }
    out
}

/// What the options have no effect on is refused: the same table, short enough for a terminal.
pub(super) fn help() -> String {
    let mut out =
        "Which option combines with which question (1: one value, +: a list; any other is refused).\ndin: also oracle-general; csv: also json; bus: chrome and vcd.\n\n".to_owned();
    let heads = ["counts", "curve", "contend", "origins", "heat", "din", "csv", "bus", "to-bus", "trace"];
    let _ = writeln!(out, "  {:<20}{}", "", heads.map(|head| format!("{head:>8}")).concat());
    for Rule { option, takes, of } in &RULES {
        let cell = |takes: &Takes| match takes {
            Nothing => "",
            One => "1",
            List => "+",
        };
        let cells: String = takes.iter().map(|takes| format!("{:>8}", cell(takes))).collect();
        let trace = of_trace(*of);
        let _ = writeln!(out, "{}", format!("  --{option:<18}{cells}{trace:>8}").trim_end());
    }
    out
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::*;
    use crate::cli::{Arguments, Command};

    /// Options of the command that ask a question, or that every question takes.
    const ASKING: [&str; 6] = ["curve", "contention", "origins", "heat-map", "export", "to-bus"];

    #[test]
    fn every_option_is_in_the_table() {
        let command = Arguments::command();
        let replay = command.find_subcommand("replay").expect("a command");
        let options = replay.get_arguments().filter_map(|argument| argument.get_long());
        let mut options: Vec<_> =
            options.filter(|option| !ASKING.contains(option) && !["help", "version"].contains(option)).collect();
        let mut known: Vec<_> = RULES.iter().map(|rule| rule.option).collect();
        options.sort_unstable();
        known.sort_unstable();
        assert_eq!(options, known);
    }

    #[test]
    fn the_docs_have_the_same_table() {
        let docs = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/replay.md")).expect("docs");
        assert!(docs.contains(&table()), "expected in docs/replay.md:\n{}", table());
    }

    #[test]
    fn options_are_found_on_the_command_line() {
        for (line, option) in [
            ("marti replay o --curve --ways 2", "--ways"),
            ("marti replay o --curve --local-memory all --replacement lru", "--local-memory"),
            ("marti replay o --origins --bus-width 8", "--bus-width"),
            ("marti replay o --export csv -o a.csv --line 64", "--line"),
            ("marti replay o --export din -o a.din --format json", "--format"),
            ("marti replay o -o a.csv", "--output"),
            ("marti replay o --pace fastest", "--pace"),
        ] {
            let arguments = Arguments::try_parse_from(line.split(' ')).unwrap_or_else(|error| panic!("{error}"));
            let Command::Replay(replay) = arguments.command else { panic!("{line}") };
            let refusal = replay.given.check(replay.asked.question(&replay.to_bus), Subject::Recording);
            let message = refusal.expect_err(line).message;
            assert!(message.starts_with(&format!("{option} has no effect on ")), "{line}: {message}");
        }
    }

    #[test]
    fn what_has_no_effect_is_refused_with_what_it_has_one_on() {
        let refused = |option: &str, question, subject| {
            let given = Given(vec![option.to_owned()]);
            given.check(question, subject).err().map(|failure| failure.message)
        };
        assert_eq!(
            refused("ways", Question::Curve, Subject::Recording).as_deref(),
            Some(
                "--ways has no effect on --curve, expected it with a table of counts, --contention, --origins, --heat-map \
                 or --export chrome or vcd"
            )
        );
        assert_eq!(
            refused("verify", Question::Counts, Subject::Recording).as_deref(),
            Some("--verify has no effect on a table of counts, expected it with --curve")
        );
        assert_eq!(
            refused("nodes", Question::Counts, Subject::Trace).as_deref(),
            Some("--nodes has no effect on a trace, which is that of one node, expected a recording")
        );
        assert_eq!(
            refused("line", Question::Contention, Subject::Trace).as_deref(),
            Some("--contention: a trace has no tiles, rays or nodes, expected a recording")
        );
        assert_eq!(refused("line", Question::Curve, Subject::Trace), None);
    }
}
