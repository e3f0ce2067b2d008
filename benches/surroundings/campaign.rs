//! What came of many trials.

use std::collections::BTreeMap;

use crate::kind::Kind;
use crate::trial::{Outcome, Trial};

#[derive(Default)]
pub(crate) struct Campaign(BTreeMap<Kind, Tally>);

#[derive(Default)]
struct Tally {
    /// Of those that took effect.
    runs: usize,
    without_effect: usize,
    /// A fault counts whether or not the disturbance took effect.
    verdicts: BTreeMap<String, usize>,
    longest_seconds: f64,
}

pub(crate) const COLUMNS: &str = "kind,seed,effect,verdict,ends,seconds,settings,done,confirmed,faults,command";

pub(crate) fn row(trial: &Trial, outcome: &Outcome) -> String {
    let quoted = |text: String| format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "));
    let ends: Vec<String> = outcome.ends.iter().map(|end| format!("{end:?}")).collect();
    format!(
        "{},{},{},{},{},{:.1},{},{},{},{},{}",
        trial.kind.name(),
        trial.seed,
        if trial.kind.took_effect(&outcome.confirmed) { "yes" } else { "no" },
        quoted(verdict(outcome).to_owned()),
        quoted(ends.join(" ")),
        outcome.seconds,
        quoted(trial.sets.join(" ")),
        quoted(outcome.done.join("; ")),
        quoted(outcome.confirmed.join("; ")),
        quoted(outcome.faults.join("; ")),
        quoted(trial.command()),
    )
}

/// The first of its faults without the particulars.
fn verdict(outcome: &Outcome) -> &str {
    outcome.faults.first().map_or("good", |fault| fault.split(':').next().unwrap_or_default())
}

impl Campaign {
    pub(crate) fn add(&mut self, trial: &Trial, outcome: &Outcome) {
        let tally = self.0.entry(trial.kind).or_default();
        let took_effect = trial.kind.took_effect(&outcome.confirmed);
        *if took_effect { &mut tally.runs } else { &mut tally.without_effect } += 1;
        if took_effect || !outcome.faults.is_empty() {
            *tally.verdicts.entry(verdict(outcome).to_owned()).or_default() += 1;
        }
        tally.longest_seconds = tally.longest_seconds.max(outcome.seconds);
    }

    /// Of those that took effect.
    pub(crate) fn runs(&self, kind: Kind) -> usize {
        self.0.get(&kind).map_or(0, |tally| tally.runs)
    }

    pub(crate) fn bad(&self) -> usize {
        let verdicts = self.0.values().flat_map(|tally| &tally.verdicts);
        verdicts.filter(|(verdict, _)| *verdict != "good").map(|(_, count)| count).sum()
    }

    pub(crate) fn table(&self) -> String {
        let mut table = format!("{:22} {:>5} {:>10} {:>10}  verdicts\n", "kind", "runs", "no effect", "longest, s");
        for (kind, Tally { runs, without_effect, verdicts, longest_seconds }) in &self.0 {
            let verdicts: Vec<String> = verdicts.iter().map(|(verdict, count)| format!("{count} {verdict}")).collect();
            let name = kind.name();
            table +=
                &format!("{name:22} {runs:5} {without_effect:10} {longest_seconds:10.1}  {}\n", verdicts.join(", "));
        }
        let all: usize = self.0.values().map(|tally| tally.runs).sum();
        table + &format!("{all} runs that took effect, {} not good\n", self.bad())
    }
}
