//! Commands that may have been meant by one that there is not.

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, Error};

/// The error with all commands that a slip of the keyboard turns into the word that was typed, if it is about such a word.
pub(super) fn with_commands(mut error: Error, command: &Command) -> Error {
    if error.kind() != ErrorKind::InvalidSubcommand {
        return error;
    }
    let Some(ContextValue::String(typed)) = error.get(ContextKind::InvalidSubcommand) else { return error };
    let names = commands(typed, command);
    if !names.is_empty() {
        error.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(names));
    }
    error
}

/// The nearest first.
fn commands(typed: &str, command: &Command) -> Vec<String> {
    let slips_max = 1 + typed.chars().count() / 4;
    let mut near: Vec<(usize, &str)> = command
        .get_subcommands()
        .map(|command| (strsim::damerau_levenshtein(typed, command.get_name()), command.get_name()))
        .filter(|(slips, _)| *slips <= slips_max)
        .collect();
    near.sort_unstable();
    near.into_iter().map(|(_, name)| name.to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::cli::Arguments;

    #[test]
    fn slips_of_the_keyboard_are_understood() {
        for (typed, expected) in [
            ("rn", &["run"][..]),
            ("rednder", &["render"]),
            ("chek", &["check"]),
            ("replya", &["replay"]),
            ("nod", &["node"]),
            ("walk", &[]),
        ] {
            assert_eq!(commands(typed, &Arguments::command()), expected, "{typed}");
        }
    }
}
