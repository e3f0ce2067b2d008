//! What went wrong on the way, as text that may come from any process.

use std::fmt::Write;
use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most characters of an incident's text; escapes count as they are written.
const TEXT_MAX: usize = 500;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Incident {
    /// Since the run began.
    pub seconds: f64,
    /// One line of at most 500 characters that a terminal can show, and a note where it was longer.
    pub text: String,
}

impl Incident {
    pub fn new(time: Duration, text: &str) -> Self {
        Self { seconds: time.as_secs_f64(), text: line(text) }
    }
}

/// A text of any origin as one line that does nothing but appear: what a terminal would obey is escaped, what is too
/// long is cut.
pub fn line(text: &str) -> String {
    let mut line = String::new();
    let mut characters = text.char_indices();
    let mut length = 0;
    for (at, character) in characters.by_ref() {
        let before = line.len();
        if is_shown(character) {
            line.push(character);
            length += 1;
        } else {
            line.extend(character.escape_unicode());
            length += line.len() - before;
        }
        if length > TEXT_MAX {
            line.truncate(before);
            // Writing into a string does not fail.
            let _ = write!(line, "… ({} bytes more)", text.len() - at);
            break;
        }
    }
    line
}

/// Neither a control character nor one that changes the direction or the place of those around it (Unicode, UAX 9).
fn is_shown(character: char) -> bool {
    let moves =
        matches!(character, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
    !character.is_control() && !moves
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_has_nothing_to_obey() {
        assert_eq!(line("node 1 died: signal 9 — as ever"), "node 1 died: signal 9 — as ever");
        let forged = line("\x1b[2J\x1b[31mx\r\nimage        512x512, sha256 00\u{202e}\u{9b}1m");
        let expected = "\\u{1b}[2J\\u{1b}[31mx\\u{d}\\u{a}image        512x512, sha256 00\\u{202e}\\u{9b}1m";
        assert_eq!(forged, expected);
    }

    #[test]
    fn a_long_text_is_cut_and_it_says_so() {
        assert_eq!(line(&"a".repeat(TEXT_MAX)), "a".repeat(TEXT_MAX));
        assert_eq!(line(&"a".repeat(60_000)), "a".repeat(TEXT_MAX) + "… (59500 bytes more)");
        let escaped = line(&"\x1b".repeat(60_000));
        assert!(escaped.len() < TEXT_MAX + 40 && escaped.ends_with(" bytes more)"), "{escaped}");
        assert!(line(&"ä".repeat(60_000)).chars().count() < TEXT_MAX + 40);
    }
}
