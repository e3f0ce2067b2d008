//! Reads a schedule:
//!
//! ```text
//! schedule = entry { ";" entry } [ ";" ]
//! entry    = fault | "random" "(" count [ kind ] ")" | "seed" "=" number
//! fault    = verb kind [ number ] "@" when [ "for" seconds ]
//! verb     = "kill" | "stop" | "cut" | "corrupt"
//! kind     = "bus" | "master" | "node" | "display"
//! when     = decimal "%" | seconds
//! seconds  = decimal "s"
//! ```

use std::str::FromStr;

use super::schedule::{Entry, FAULTS_MAX, FaultSchedule};
use super::{Deed, Fault, Kind, Percent, Seconds, Target, When};

const BYTES_MAX: usize = 16 << 10;
const SEED: u64 = 1;
/// Of what is there instead of what was expected, characters.
const FOUND_MAX: usize = 16;

/// Where a schedule cannot be read, and why.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("column {column}: {what}")]
pub struct ParseError {
    /// From 1, characters.
    pub column: usize,
    pub what: String,
}

impl FromStr for FaultSchedule {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Self, ParseError> {
        let mut reader = Reader { text, at: 0 };
        if text.len() > BYTES_MAX {
            return Err(reader.refuse(0, format!("a schedule of {} bytes, at most {BYTES_MAX} are read", text.len())));
        }
        reader.schedule()
    }
}

struct Reader<'a> {
    text: &'a str,
    /// Bytes read.
    at: usize,
}

impl<'a> Reader<'a> {
    fn schedule(&mut self) -> Result<FaultSchedule, ParseError> {
        let (mut entries, mut seed, mut faults) = (Vec::new(), None, 0);
        loop {
            self.skip_space();
            let start = self.at;
            match self.word() {
                "seed" if seed.is_some() => return Err(self.refuse(start, "a second seed".to_owned())),
                "seed" => seed = Some(self.seed()?),
                word => {
                    let entry = self.entry(start, word)?;
                    faults += if let Entry::Random { count, .. } = entry { usize::from(count) } else { 1 };
                    entries.push(entry);
                }
            }
            if faults > FAULTS_MAX {
                return Err(self.refuse(start, format!("more than {FAULTS_MAX} faults")));
            }
            let more = self.takes(";");
            self.skip_space();
            if self.rest().is_empty() {
                break;
            } else if !more {
                return Err(self.expected("; or the end"));
            }
        }
        if entries.is_empty() {
            return Err(self.expected("a fault"));
        }
        Ok(FaultSchedule { entries, seed: seed.unwrap_or(SEED) })
    }

    fn entry(&mut self, start: usize, word: &str) -> Result<Entry, ParseError> {
        let deed = match word {
            "random" => return self.random(),
            "kill" => Deed::Kill,
            "corrupt" => Deed::Corrupt,
            "stop" => Deed::Stop(Seconds(0)),
            "cut" => Deed::Cut(Seconds(0)),
            _ => {
                self.at = start;
                return Err(self.expected("kill, stop, cut, corrupt, random or seed"));
            }
        };
        let on = self.target(deed)?;
        self.expect("@")?;
        let when = self.when()?;
        let deed = match deed {
            Deed::Stop(_) => Deed::Stop(self.time_span()?),
            Deed::Cut(_) => Deed::Cut(self.time_span()?),
            Deed::Kill | Deed::Corrupt => deed,
        };
        Ok(Entry::Fault(Fault { deed, on, when }))
    }

    fn random(&mut self) -> Result<Entry, ParseError> {
        self.expect("(")?;
        let count = self.number("how many faults", 1, FAULTS_MAX as u64)? as u16;
        self.skip_space();
        let kind = if self.rest().starts_with(')') { None } else { Some(self.kind()?) };
        self.expect(")")?;
        Ok(Entry::Random { count, kind })
    }

    fn seed(&mut self) -> Result<u64, ParseError> {
        self.expect("=")?;
        self.number("a seed", 0, u64::MAX)
    }

    fn target(&mut self, deed: Deed) -> Result<Target, ParseError> {
        self.skip_space();
        let start = self.at;
        let kind = self.kind()?;
        if deed == Deed::Corrupt && kind != Kind::Node {
            return Err(self.refuse(start, format!("only a node can be corrupted, not a {kind}")));
        }
        self.skip_space();
        let numbered = self.rest().starts_with(|next: char| next.is_ascii_digit());
        if numbered && kind == Kind::Display {
            return Err(self.refuse(self.at, "the display has no number: there is one".to_owned()));
        }
        let number = if numbered { Some(self.number("a number", 0, u64::from(u16::MAX))? as u16) } else { None };
        Ok(Target { kind, number })
    }

    fn kind(&mut self) -> Result<Kind, ParseError> {
        self.skip_space();
        let start = self.at;
        match self.word() {
            "bus" => Ok(Kind::Bus),
            "master" => Ok(Kind::Master),
            "node" => Ok(Kind::Node),
            "display" => Ok(Kind::Display),
            "manager" => {
                let why = "the manager brings about the faults and cannot watch its own: expected bus, master, node or display";
                Err(self.refuse(start, why.to_owned()))
            }
            _ => {
                self.at = start;
                Err(self.expected("bus, master, node or display"))
            }
        }
    }

    fn when(&mut self) -> Result<When, ParseError> {
        self.skip_space();
        let start = self.at;
        let thousandths = self.thousandths("when: a share of the tiles such as 10%, or a time such as 2s")?;
        if self.takes("%") {
            if thousandths >= u64::from(Percent::LIMIT) {
                return Err(self.refuse(start, "expected less than 100%: then all tiles are done".to_owned()));
            }
            return Ok(When::Done(Percent(thousandths as u32)));
        }
        self.seconds(start, thousandths, "% or s", 0).map(When::After)
    }

    fn time_span(&mut self) -> Result<Seconds, ParseError> {
        if !self.takes("for") {
            return Err(self.expected("for how long, such as for 2s"));
        }
        self.skip_space();
        let start = self.at;
        let thousandths = self.thousandths("a time such as 2s")?;
        self.seconds(start, thousandths, "s", 1)
    }

    fn seconds(&mut self, start: usize, thousandths: u64, unit: &str, min: u64) -> Result<Seconds, ParseError> {
        if !self.takes("s") {
            return Err(self.expected(unit));
        }
        if !(min..=u64::from(Seconds::MAX)).contains(&thousandths) {
            return Err(self.refuse(start, format!("expected {} to {} s", min as f64 / 1e3, Seconds::MAX / 1000)));
        }
        Ok(Seconds(thousandths as u32))
    }

    fn number(&mut self, what: &str, min: u64, max: u64) -> Result<u64, ParseError> {
        self.skip_space();
        let start = self.at;
        let digits = self.digits();
        if digits.is_empty() {
            return Err(self.expected(what));
        }
        let number = digits.parse().ok().filter(|number| (min..=max).contains(number));
        number.ok_or_else(|| self.refuse(start, format!("expected {what} from {min} to {max}")))
    }

    /// A decimal with three places at most, times a thousand; one that is too large is as large as any.
    fn thousandths(&mut self, what: &str) -> Result<u64, ParseError> {
        self.skip_space();
        let whole = self.digits();
        if whole.is_empty() {
            return Err(self.expected(what));
        }
        let whole = whole.parse().unwrap_or(u64::MAX).saturating_mul(1000);
        if !self.rest().starts_with('.') {
            return Ok(whole);
        }
        self.at += 1;
        let start = self.at;
        let places = self.digits();
        if !(1..=3).contains(&places.len()) {
            return Err(self.refuse(start, "expected one to three decimal places".to_owned()));
        }
        let part: u64 = format!("{places:0<3}").parse().unwrap_or_default();
        Ok(whole.saturating_add(part))
    }

    fn expect(&mut self, what: &str) -> Result<(), ParseError> {
        if self.takes(what) { Ok(()) } else { Err(self.expected(what)) }
    }

    /// Whether `what` comes next; it is read then.
    fn takes(&mut self, what: &str) -> bool {
        self.skip_space();
        let takes = self.rest().starts_with(what);
        self.at += if takes { what.len() } else { 0 };
        takes
    }

    /// Letters, as many as follow.
    fn word(&mut self) -> &'a str {
        self.while_next(|next| next.is_ascii_alphabetic())
    }

    fn digits(&mut self) -> &'a str {
        self.while_next(|next| next.is_ascii_digit())
    }

    fn while_next(&mut self, belongs: impl Fn(char) -> bool) -> &'a str {
        let rest = &self.text[self.at..];
        let bytes = rest.find(|next| !belongs(next)).unwrap_or(rest.len());
        self.at += bytes;
        &rest[..bytes]
    }

    fn skip_space(&mut self) {
        self.while_next(char::is_whitespace);
    }

    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    /// What comes next is not what was expected.
    fn expected(&mut self, what: &str) -> ParseError {
        self.skip_space();
        let found: String = self.rest().chars().take_while(|next| !next.is_whitespace()).take(FOUND_MAX).collect();
        let found = if found.is_empty() { "the end".to_owned() } else { format!("`{found}`") };
        self.refuse(self.at, format!("expected {what}, found {found}"))
    }

    /// `at`: bytes before it.
    fn refuse(&self, at: usize, what: String) -> ParseError {
        ParseError { column: 1 + self.text[..at].chars().count(), what }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn refused(text: &str) -> String {
        text.parse::<FaultSchedule>().expect_err(text).to_string()
    }

    #[test]
    fn space_does_not_matter() {
        let schedule: FaultSchedule =
            "kill node@10%; stop bus@30% for 2s; cut node 3@50% for 5s; corrupt node 2@60%; seed=7"
                .parse()
                .expect("the example");
        let spaced = " kill  node @ 10 % ;stop bus@30.0%for 2 s;cut node3@50%for 5.00s;corrupt node 2@60%;seed = 7 ; ";
        assert_eq!(spaced.parse(), Ok(schedule.clone()));
        assert_eq!(
            schedule.to_string(),
            "kill node@10%; stop bus@30% for 2s; cut node 3@50% for 5s; corrupt node 2@60%; seed=7"
        );
    }

    #[test]
    fn a_bad_schedule_is_told_where_and_what_was_expected() {
        for (text, told) in [
            ("", "column 1: expected kill, stop, cut, corrupt, random or seed, found the end"),
            ("seed=3", "column 7: expected a fault, found the end"),
            ("kil node@1%", "column 1: expected kill, stop, cut, corrupt, random or seed, found `kil`"),
            ("kill nodes@1%", "column 6: expected bus, master, node or display, found `nodes@1%`"),
            (
                "kill manager@1%",
                "column 6: the manager brings about the faults and cannot watch its own: expected bus, \
             master, node or display",
            ),
            ("kill node", "column 10: expected @, found the end"),
            ("kill node 70000@1%", "column 11: expected a number from 0 to 65535"),
            ("kill display 0@1%", "column 14: the display has no number: there is one"),
            ("corrupt bus@1%", "column 9: only a node can be corrupted, not a bus"),
            (
                "kill node@",
                "column 11: expected when: a share of the tiles such as 10%, or a time such as 2s, found the end",
            ),
            ("kill node@5", "column 12: expected % or s, found the end"),
            ("kill node@100%", "column 11: expected less than 100%: then all tiles are done"),
            ("kill node@1.2345%", "column 13: expected one to three decimal places"),
            ("kill node@4000s", "column 11: expected 0 to 3600 s"),
            ("kill node@99999999999999999999999s", "column 11: expected 0 to 3600 s"),
            ("kill node@1% for 2s", "column 14: expected ; or the end, found `for`"),
            ("stop node@1%", "column 13: expected for how long, such as for 2s, found the end"),
            ("stop node@1% for 0s", "column 18: expected 0.001 to 3600 s"),
            ("stop node@1% for 3m", "column 19: expected s, found `m`"),
            ("kill node@1%, kill bus@2%", "column 13: expected ; or the end, found `,`"),
            ("kill node@1%; seed=x", "column 20: expected a seed, found `x`"),
            ("seed=1; seed=2; kill node@1%", "column 9: a second seed"),
            ("random(0)", "column 8: expected how many faults from 1 to 256"),
            ("random(3 nodes)", "column 10: expected bus, master, node or display, found `nodes)`"),
            ("random(200); random(57)", "column 14: more than 256 faults"),
            ("kill nöde@1%", "column 6: expected bus, master, node or display, found `nöde@1%`"),
        ] {
            assert_eq!(refused(text), told, "{text}");
        }
        assert_eq!(refused(&" ".repeat(20_000)), "column 1: a schedule of 20000 bytes, at most 16384 are read");
    }

    proptest! {
        #[test]
        fn nothing_panics(text in "(kill|stop|cut|corrupt|random|seed|node|bus|for|[ @;=().%s0-9äß\\PC]){0,20}") {
            if let Ok(schedule) = text.parse::<FaultSchedule>() {
                prop_assert_eq!(schedule.to_string().parse(), Ok(schedule));
            }
        }
    }
}
