//! `marti replay TRACE`: a trace that came from elsewhere.

use std::path::Path;

use clap::Args;

use super::combinations::Given;
use crate::cli::Failure;
use ground::outlet;
use machine::replay::importers::{
    self, Column, CsvOptions, ImportFormat, ImportOptions, Imported, Notes, STANDARD_INPUT, Separator,
};
use machine::replay::model::writes::{WritePolicy, Writing};
use machine::replay::plan::setting::{Policy, Setting};

/// How a trace is read that came from elsewhere.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Traces from elsewhere")]
pub(super) struct ImportArguments {
    /// The format of a trace that is not recognised by its content or name
    #[arg(long, value_name = "FORMAT", value_enum)]
    import: Option<ImportFormat>,
    /// Each object takes one unit of memory, whatever its size: --local-memory counts objects
    #[arg(long)]
    ignore_object_size: bool,
    /// The column of addresses of bytes: its name, or its number from 1
    #[arg(long, value_name = "COLUMN")]
    csv_address: Option<Column>,
    /// The column of ids of objects, numbers or text
    #[arg(long, value_name = "COLUMN", conflicts_with_all = ["csv_address", "csv_address_unit"])]
    csv_id: Option<Column>,
    /// The column of sizes, in bytes
    #[arg(long, value_name = "COLUMN")]
    csv_size: Option<Column>,
    /// The column of what references do: r or w, get or set, and others
    #[arg(long, value_name = "COLUMN")]
    csv_operation: Option<Column>,
    /// Bytes that an address counts, such as 512 for blocks of a disk
    #[arg(long, value_name = "BYTES", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    csv_address_unit: Option<u32>,
    /// What is between columns: comma, tab, semicolon, blank, or a character
    #[arg(long, value_name = "SEPARATOR")]
    csv_separator: Option<Separator>,
    /// Whether the first row names the columns
    #[arg(long, value_name = "ANSWER", value_enum)]
    csv_header: Option<Answer>,
    /// When what was written leaves a memory
    #[arg(long, value_name = "POLICY", value_enum, default_value_t)]
    write_policy: WritePolicy,
    /// Whether a line that is missing is brought in to be written
    #[arg(long, value_name = "ANSWER", value_enum, default_value_t = Answer::Yes)]
    write_allocate: Answer,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(super) enum Answer {
    Yes,
    No,
}

impl ImportArguments {
    /// Whether the path is a trace: no folder of a run, or called a trace.
    pub(super) fn is_of(&self, path: &Path) -> bool {
        let is_trace = self.import.is_some() || path.exists() || ImportFormat::is_named(path);
        path.as_os_str() == STANDARD_INPUT || is_trace && !path.is_dir()
    }

    pub(super) fn ignores_object_sizes(&self) -> bool {
        self.ignore_object_size
    }

    pub(super) fn writing(&self) -> Writing {
        Writing { policy: self.write_policy, allocate: self.write_allocate == Answer::Yes }
    }

    /// Reads a trace for these settings. Those of a trace of objects get lines of one unit.
    pub(super) fn import(&self, path: &Path, settings: &mut [Setting], given: &Given) -> Result<Imported, Failure> {
        let line_bytes = settings.iter().map(|setting| setting.line).min().unwrap_or(Setting::imported().line);
        let options = ImportOptions { format: self.import, csv: self.csv(), line_bytes_min: line_bytes };
        let imported = importers::import(path, &options)?;
        if imported.is_of_objects() {
            if given.has("line") {
                return Err(Failure::bad_input("--line has no effect on objects, expected a trace of bytes"));
            }
            settings.iter_mut().for_each(|setting| setting.line = 1);
        } else if self.ignore_object_size {
            return Err(Failure::bad_input(
                "--ignore-object-size: a trace of bytes has no objects, expected one of objects",
            ));
        }
        let notes = imported.notes();
        let is_written = given.has("write-policy") || given.has("write-allocate");
        if is_written && notes.writes == 0 {
            let what = "--write-policy and --write-allocate: a trace without writes, expected one with writes";
            return Err(Failure::bad_input(what));
        }
        let is_optimal = |setting: &Setting| setting.replacement == Policy::Optimal;
        if is_written && settings.iter().all(is_optimal) {
            let what =
                "--write-policy and --write-allocate have no effect with optimal, for which writes count as reads";
            return Err(Failure::bad_input(what));
        }
        let of_all_sizes = given.has("curve") || given.has("classes") || settings.iter().any(is_optimal);
        if notes.invalidations > 0 && of_all_sizes {
            let what = "a trace with invalidations has no curve, classes of misses or optimum: expected counts of other policies";
            return Err(Failure::bad_input(what));
        }
        let counts_reads = given.has("curve") || settings.iter().any(is_optimal);
        let has_sizes = imported.is_of_objects() && !self.ignore_object_size;
        if notes.writes > 0 && counts_reads && !has_sizes {
            let of = if given.has("curve") { "a curve" } else { "optimal" };
            outlet::say(format_args!("note: for {of} {} writes count as reads", notes.writes));
        }
        if notes.writes > 0 && !is_written && !given.has("curve") && !has_sizes {
            let how = "--write-policy back, --write-allocate yes";
            outlet::say(format_args!("note: {} of {} references are writes: {how}", notes.writes, notes.references));
        }
        self.print_notes(&imported);
        Ok(imported)
    }

    fn csv(&self) -> CsvOptions {
        CsvOptions {
            address: self.csv_address.clone(),
            id: self.csv_id.clone(),
            size: self.csv_size.clone(),
            operation: self.csv_operation.clone(),
            address_unit: self.csv_address_unit,
            separator: self.csv_separator,
            header: self.csv_header.map(|answer| answer == Answer::Yes),
        }
    }

    /// What of a trace is not simulated as it is.
    fn print_notes(&self, imported: &Imported) {
        let Notes { left_out, resized, unknown_operations, .. } = imported.notes();
        for (count, what) in [
            (left_out, "references to nothing, of size 0, are left out"),
            (resized, "references are to objects of another size than at first"),
            (unknown_operations, "references with an operation that is not known count as reads"),
        ] {
            if count > 0 {
                outlet::say(format_args!("note: {count} {what}"));
            }
        }
    }
}
