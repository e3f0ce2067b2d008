//! What came of the runs of a campaign.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::network::Disturbed;
use crate::trial::Trial;

pub(crate) struct Outcome {
    pub(crate) verdict: &'static str,
    pub(crate) exit: Option<i32>,
    pub(crate) seconds: f64,
    pub(crate) report: Value,
    /// By the links' cuts.
    pub(crate) disturbed: Disturbed,
}

impl Outcome {
    pub(crate) const COLUMNS: &str = "schedule,verdict,exit,seconds,tiles,reissued,faults,longest_wait_seconds,link_cuts,\
                                      longest_wait_in_journal_seconds,books,chaos,command";

    pub(crate) fn row(&self, trial: &Trial) -> String {
        let Self { verdict, seconds, report, disturbed, .. } = self;
        let exit = self.exit.map_or_else(String::new, |code| code.to_string());
        let (tiles, chaos, holds) = (&report["tiles"], &report["chaos"], &report["conservation"]["holds"]);
        let wait = chaos["longest_wait_seconds"].as_f64().unwrap_or_default();
        format!(
            "{},{verdict},{exit},{seconds:.3},{},{},{},{wait:.3},{},{:.3},{holds},\"{}\",\"{}\"",
            trial.number,
            tiles["done"],
            tiles["reissued"],
            chaos["carried_out"],
            disturbed.cuts,
            disturbed.longest_wait.as_secs_f64(),
            chaos["schedule"].as_str().unwrap_or(&trial.chaos),
            trial.command_line().replace('"', "\"\""),
        )
    }
}

/// Of all runs.
#[derive(Default)]
pub(crate) struct Campaign {
    verdicts: BTreeMap<&'static str, usize>,
    faults: u64,
    /// Runs whose bus or master did not live to close its books.
    without_books: usize,
    /// Seconds; of runs with one fault that came to pass, by what was done to whom.
    waits: BTreeMap<String, Vec<f64>>,
    all_waits: Vec<(f64, u64)>,
    link_cuts: u64,
    /// As the journal grows; of runs with cut links.
    waits_in_journal: Vec<(f64, u64)>,
}

impl Campaign {
    pub(crate) fn add(&mut self, trial: &Trial, outcome: Outcome) {
        *self.verdicts.entry(outcome.verdict).or_default() += 1;
        let (chaos, books) = (&outcome.report["chaos"], &outcome.report["conservation"]);
        let carried_out = chaos["carried_out"].as_u64().unwrap_or_default();
        self.faults += carried_out;
        self.without_books += usize::from(books.is_null());
        self.link_cuts += outcome.disturbed.cuts;
        if outcome.disturbed.cuts > 0 {
            let wait = outcome.disturbed.longest_wait.as_secs_f64();
            self.waits_in_journal.push((wait, trial.number));
            if trial.chaos.is_empty() && trial.cuts().len() == 1 {
                self.waits.entry(format!("link of host {}", trial.cuts()[0].host)).or_default().push(wait);
            }
        }
        let (Some(wait), Some(schedule)) = (chaos["longest_wait_seconds"].as_f64(), chaos["schedule"].as_str()) else {
            return;
        };
        self.all_waits.push((wait, trial.number));
        if carried_out == 1 && !schedule.contains(';') && outcome.disturbed.cuts == 0 {
            // "kill node 3@10% …"
            let done_to = schedule.split([' ', '@']).take(2).collect::<Vec<_>>().join(" ");
            self.waits.entry(done_to).or_default().push(wait);
        }
    }

    pub(crate) fn bad(&self) -> usize {
        self.verdicts.iter().filter(|(verdict, _)| **verdict != "good").map(|(_, count)| count).sum()
    }

    pub(crate) fn table(&mut self) -> String {
        let mut table = String::new();
        let mut line = |text: String| table.push_str(&(text + "\n"));
        for (verdict, count) in &self.verdicts {
            line(format!("{verdict:24} {count:6}"));
        }
        line(format!("{:24} {:6}", "faults carried out", self.faults));
        line(format!("{:24} {:6}", "runs without books", self.without_books));
        line(format!("{:24} {:6}", "links cut", self.link_cuts));
        if let Some((wait, number)) = self.waits_in_journal.iter().max_by(|a, b| a.0.total_cmp(&b.0)) {
            line(format!("{:24} {wait:6.3} s, schedule {number}", "longest, links cut"));
        }
        if let Some((wait, number)) = self.all_waits.iter().max_by(|a, b| a.0.total_cmp(&b.0)) {
            line(format!("{:24} {wait:6.3} s, schedule {number}", "longest wait for a tile"));
        }
        line("\none fault alone            runs  median  longest wait, s".to_owned());
        for (done_to, waits) in &mut self.waits {
            waits.sort_by(f64::total_cmp);
            let (median, longest) = (waits[waits.len() / 2], waits[waits.len() - 1]);
            line(format!("{done_to:24} {:6} {median:7.3} {longest:7.3}", waits.len()));
        }
        table
    }
}
