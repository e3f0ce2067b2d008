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
    HeatMapMisses,
    HeatMapOctree,
    /// Line references of one memory: `din`, `oracle-general`.
    ExportLines,
    /// Record reads: `csv`, `json`.
    ExportReads,
    /// A simulated bus: `chrome`, `vcd`.
    ExportBus,
    ToBus,
}

impl Question {
    const ALL: [Self; 10] = [
        Self::Counts,
        Self::Curve,
        Self::Contention,
        Self::Origins,
        Self::HeatMapMisses,
        Self::HeatMapOctree,
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
            Self::HeatMapMisses => "heat-map misses",
            Self::HeatMapOctree => "heat-map octree",
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
            Self::HeatMapMisses => "--heat-map misses",
            Self::HeatMapOctree => "--heat-map octree",
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
    /// A trace that came from elsewhere, of bytes, or of objects of which each takes one unit.
    Trace,
    /// A trace of objects that have sizes.
    Objects,
}

impl Subject {
    const ALL: [Self; 3] = [Self::Recording, Self::Trace, Self::Objects];

    /// The subject, and what else there is.
    fn named(self) -> [&'static str; 2] {
        match self {
            Self::Recording => ["a recording", "a trace that came from elsewhere"],
            Self::Trace => ["a trace, which is that of one node", "a recording"],
            Self::Objects => ["caches of objects with sizes", "a recording, or --ignore-object-size"],
        }
    }
}

struct Rule {
    /// Without its dashes.
    option: &'static str,
    /// By question, in the order of [`Question::ALL`].
    takes: [Takes; Question::ALL.len()],
    /// Whether it has an effect, by subject.
    of: [bool; Subject::ALL.len()],
}

/// `takes`: a character per question, `+` for a list, `1` for one value, `.` for nothing. `of`: the letters of the subjects, r, t and o.
const fn rule(option: &'static str, takes: &str, of: &str) -> Rule {
    let (takes, of) = (takes.as_bytes(), of.as_bytes());
    let mut rule = Rule { option, takes: [Nothing; Question::ALL.len()], of: [false; Subject::ALL.len()] };
    assert!(takes.len() == Question::ALL.len(), "a character per question");
    let mut i = 0;
    while i < takes.len() {
        rule.takes[i] = match takes[i] {
            b'+' => List,
            b'1' => One,
            _ => Nothing,
        };
        i += 1;
    }
    let mut i = 0;
    while i < of.len() {
        rule.of[match of[i] {
            b'r' => Subject::Recording,
            b't' => Subject::Trace,
            _ => Subject::Objects,
        } as usize] = true;
        i += 1;
    }
    rule
}

/// What decides what a memory misses.
const MEMORY: &str = "+.111...1.";
/// What decides what a node reads.
const TILES: &str = "++111.111.";
/// What decides times alone.
const TIMES: &str = "+.1.....1.";
/// How a trace is read.
const INPUT: &str = "11........";

const RULES: [Rule; 38] = [
    rule("local-memory", MEMORY, "rot"),
    rule("line", "++111.1.1.", "rt"),
    rule("ways", MEMORY, "rt"),
    rule("replacement", MEMORY, "rot"),
    rule("nodes", "+++11.111.", "r"),
    rule("clusters", TILES, "r"),
    rule("tile-order", TILES, "r"),
    rule("assignment", TILES, "r"),
    rule("bus-width", TIMES, "r"),
    rule("arbiter", TIMES, "r"),
    rule("transactions", TIMES, "r"),
    rule("latency", TIMES, "r"),
    rule("cycles-per-word", TIMES, "r"),
    rule("octree-node", TIMES, "r"),
    rule("primitive-test", TIMES, "r"),
    rule("shading", TIMES, "r"),
    rule("local-access", TIMES, "r"),
    rule("classes", "1.........", "rt"),
    rule("timings", "1.........", "r"),
    rule("verify", ".1........", "rt"),
    rule("node", "......11..", "r"),
    rule("import", INPUT, "to"),
    rule("ignore-object-size", INPUT, "t"),
    rule("csv-address", INPUT, "to"),
    rule("csv-id", INPUT, "to"),
    rule("csv-size", INPUT, "to"),
    rule("csv-operation", INPUT, "to"),
    rule("csv-address-unit", INPUT, "to"),
    rule("csv-separator", INPUT, "to"),
    rule("csv-header", INPUT, "to"),
    rule("write-policy", "1.........", "t"),
    rule("write-allocate", "1.........", "t"),
    rule("format", "1111.....1", "rot"),
    rule("out", "....11111.", "r"),
    rule("partial", "1111111111", "r"),
    rule("quiet", "1.1.......", "rot"),
    rule("token", ".........1", "r"),
    rule("pace", ".........1", "r"),
];

/// Questions about a subject: a trace has no tiles, rays, sections or nodes, and objects of many sizes have no curve.
const fn questions_of(subject: Subject) -> &'static [Question] {
    match subject {
        Subject::Recording => &Question::ALL,
        Subject::Trace => &[Question::Counts, Question::Curve],
        Subject::Objects => &[Question::Counts],
    }
}

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
        let [here, expected] = subject.named();
        if !questions_of(subject).contains(&question) {
            let what = format!("{} has no effect on {here}, expected {expected}", question.typed());
            return Err(Failure::bad_input(what));
        }
        for Rule { option, takes, of } in RULES.iter().filter(|rule| self.has(rule.option)) {
            if !of[subject as usize] {
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

/// The table of docs/replay.md.
#[cfg(test)]
fn table() -> String {
    let heads = Question::ALL.map(Question::head);
    let rule = "|---".repeat(heads.len());
    let mut out =
        format!("| option | {} | recording | trace | objects |\n|---{rule}|---|---|---|\n", heads.join(" | "));
    for Rule { option, takes, of } in &RULES {
        let cell = |takes: &Takes| match takes {
            Nothing => "",
            One => "one",
            List => "list",
        };
        let cells = takes.iter().map(cell).collect::<Vec<_>>().join(" | ");
        let of = of.map(|has_effect| if has_effect { "yes" } else { "" }).join(" | ");
        let _ = writeln!(out, "| `--{option}` | {cells} | {of} |");
    }
    out
}

/// The same table, short enough for a terminal.
pub(super) fn help() -> String {
    let mut out = "Which option combines with which question (1: one value, +: a list; any other is refused), and of what: recordings (r),\n\
                   traces from elsewhere (t), objects with sizes (o). din: also oracle-general; csv: also json; bus: chrome and vcd.\n\n"
        .to_owned();
    let heads = ["counts", "curve", "contend", "origins", "misses", "octree", "din", "csv", "bus", "to-bus", "of"];
    let _ = writeln!(out, "  {:<20}{}", "", heads.map(|head| format!("{head:>8}")).concat());
    for Rule { option, takes, of } in &RULES {
        let cell = |takes: &Takes| match takes {
            Nothing => "",
            One => "1",
            List => "+",
        };
        let cells: String = takes.iter().map(|takes| format!("{:>8}", cell(takes))).collect();
        let of: String =
            ["r", "t", "o"].iter().zip(of).map(|(letter, has_effect)| if *has_effect { letter } else { "" }).collect();
        let _ = writeln!(out, "{}", format!("  --{option:<18}{cells}{of:>8}").trim_end());
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
            ("marti replay o --heat-map octree -o a.png --replacement fifo", "--replacement"),
            ("marti replay o --export csv -o a.csv --line 64", "--line"),
            ("marti replay o --export din -o a.din --format json", "--format"),
            ("marti replay o -o a.csv", "--out"),
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
                 misses or --export chrome or vcd"
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
            Some("--contention has no effect on a trace, which is that of one node, expected a recording")
        );
        assert_eq!(refused("line", Question::Curve, Subject::Trace), None);
    }
}
