//! Key words at the beginning of lines, in colour where a terminal wants it: `--color` decides, else `NO_COLOR` and what standard
//! output or standard error is.

pub use anstream::ColorChoice as Choice;

use anstream::AutoStream;
use anstream::stream::RawStream;
use anstyle::{AnsiColor, Style};

const NAME: Style = Style::new().bold();
const NOTE: Style = AnsiColor::Cyan.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();
const ERROR: Style = AnsiColor::Red.on_default().bold();

const KEY_WORDS: [(&str, Style); 7] = [
    ("note:", NOTE),
    ("warning:", WARNING),
    ("warning", WARNING),
    ("incident", WARNING),
    ("error:", ERROR),
    ("status", ERROR),
    ("unverified", ERROR),
];

/// Decides for this process. Before that it is [`Choice::Auto`].
pub fn choose(choice: Choice) {
    choice.write_global();
}

/// A message with its key word in colour, if it begins with one and `to` is to have colours.
pub fn message(line: &str, to: &impl RawStream) -> String {
    if has_colours(to) { styled(line, None) } else { line.to_owned() }
}

/// Lines of a name and what is said of it, the names in bold or in the colours of key words, if `to` is to have colours.
pub fn summary(lines: &str, to: &impl RawStream) -> String {
    if !has_colours(to) {
        return lines.to_owned();
    }
    lines.split_inclusive('\n').map(|line| styled(line, Some(NAME))).collect()
}

fn has_colours(to: &impl RawStream) -> bool {
    AutoStream::choice(to) != Choice::Never
}

/// The line with its first word in its colour, or else in the style of `others`.
fn styled(line: &str, others: Option<Style>) -> String {
    let (word, rest) = line.split_at(line.find(char::is_whitespace).unwrap_or(line.len()));
    let known = KEY_WORDS.iter().find(|known| known.0 == word).map(|known| known.1);
    match known.or(others) {
        Some(style) if !word.is_empty() => format!("{style}{word}{style:#}{rest}"),
        _ => line.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_words_have_colours_and_other_words_have_none() {
        assert_eq!(styled("error: x", None), "\u{1b}[1m\u{1b}[31merror:\u{1b}[0m x");
        assert_eq!(styled("errors: x", None), "errors: x");
        assert_eq!(styled("rays  7\n", Some(NAME)), "\u{1b}[1mrays\u{1b}[0m  7\n");
        assert_eq!(styled("      a.png\n", Some(NAME)), "      a.png\n");
        assert_eq!(styled("status\n", None), "\u{1b}[1m\u{1b}[31mstatus\u{1b}[0m\n");
    }

    #[test]
    fn what_is_no_terminal_gets_none() {
        let file: Vec<u8> = Vec::new();
        if std::env::var_os("CLICOLOR_FORCE").is_none() {
            assert_eq!(message("error: x", &file), "error: x");
            assert_eq!(summary("rays 7\n", &file), "rays 7\n");
        }
    }
}
