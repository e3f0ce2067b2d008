//! Examples below the help of each command, as they work in a checkout.

pub(super) const RUN: &str = "Examples:
  marti run topologies/teapot.toml
  marti run topologies/teapot.toml --set cluster.nodes=9 --set cluster.local_memory.size=4KiB --out out/small
  marti run scenes/house.obj
  marti run topologies/paper-teapot-9.toml --record references
  marti run --resume out/teapot";

pub(super) const RENDER: &str = "Examples:
  marti render teapot:12 -o teapot.png --size 1024x1024
  marti render scenes/house.obj --camera-from 9,4,6 --light 5,9,3
  marti render topologies/teapot.toml --kernel single";

pub(super) const SCENE: &str = "Examples:
  marti scene gears --size 2
  marti scene balls --size 4 -o balls4.nff";

pub(super) const INSPECT: &str = "Examples:
  marti inspect gears:2
  marti inspect scenes/house.obj --format json
  marti inspect teapot --database teapot.db";

pub(super) const CHECK: &str = "Examples:
  marti check topologies/teapot.toml
  marti check topologies/teapot.toml --set cluster.nodes=9
  marti check scenes/house.obj --format json";

pub(super) const COMPARE: &str = "Examples:
  marti compare out/teapot out/small
  marti compare a.png b.png -o differences.png
  marti compare out/a out/b --format json --exit-code";

pub(super) const KEYS: &str = "Examples:
  marti keys new keys
  marti keys show keys
  marti keys rotate keys --days 30";

pub(super) const REPLAY: &str = "Examples:
  marti replay out/paper-teapot-9 --local-memory 1/32..1/4 --replacement lru,clock,optimal
  marti replay out/paper-teapot-9 --nodes 4,9,16 --bus-width 4,8 --timings
  marti replay out/paper-teapot-9 --curve
  marti replay out/paper-teapot-9 --contention --nodes 1..64x2
  marti replay trace.csv.gz --local-memory 64KiB,1MiB --ways 1,4,full";

pub(super) const VERIFY: &str = "Examples:
  marti verify gears:2 --rays 50000
  marti verify teapot:4 --rays 20000 --format json
  marti verify --watertight --rays 1000000";

pub(super) const STUDY: &str = "Examples:
  marti study paper --out out/paper
  marti study sweep topologies/paper-teapot-9.toml --nodes 9,16 --bus-width 4,8 --line 64,128 --out out/sweep";

pub(super) const SCHEMA: &str = "Examples:
  marti schema topology > topology.schema.json
  marti schema report";

pub(super) const NODE: &str = "Examples:
  marti node --join manager.example:4242 --keys keys
  marti node --join 127.0.0.1:4242 --token out/hosts/join.token";

pub(super) const MASTER: &str = "Examples:
  marti master --join manager.example:4242 --keys keys";

pub(super) const BUS: &str = "Examples:
  marti bus --join manager.example:4242 --keys keys
  marti bus --recording out/paper-teapot-9/recording";

pub(super) const DISPLAY: &str = "Examples:
  marti display --join manager.example:4242 --keys keys";

pub(super) const COMPLETIONS: &str = "Examples:
  marti completions bash > ~/.local/share/bash-completion/completions/marti
  marti completions zsh > ~/.zfunc/_marti";

pub(super) const MAN: &str = "Examples:
  marti man ~/.local/share/man/man1";

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use crate::cli::Arguments;

    #[test]
    fn every_command_has_examples_and_each_is_accepted() {
        for command in Arguments::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines: Vec<&str> = help.lines().filter(|line| line.starts_with("  marti ")).collect();
            assert!(!lines.is_empty(), "{} has no example", command.get_name());
            for line in lines {
                let words = line.split(" > ").next().into_iter().flat_map(str::split_whitespace);
                assert!(line.contains(&format!("marti {}", command.get_name())), "{line}");
                Arguments::try_parse_from(words).unwrap_or_else(|error| panic!("{line}: {error}"));
            }
        }
    }

    #[test]
    fn help_is_at_most_100_columns_wide() {
        let mut commands = vec![Arguments::command()];
        while let Some(mut command) = commands.pop() {
            for help in [command.render_help().to_string(), command.render_long_help().to_string()] {
                for line in help.lines().filter(|line| !line.trim_start().starts_with("marti ")) {
                    assert!(line.chars().count() <= 100, "{line}");
                }
            }
            commands.extend(command.get_subcommands().cloned());
        }
    }
}
