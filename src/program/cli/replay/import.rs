//! `marti replay TRACE`: a trace that came from elsewhere.

use std::path::Path;

use clap::Args;

use crate::cli::Failure;
use ground::outlet;
use machine::replay::importers::{
    self, Column, CsvOptions, ImportFormat, ImportOptions, Imported, Notes, STANDARD_INPUT, Separator,
};

/// How a trace is read that came from elsewhere.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Traces of others")]
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
}

#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(super) enum Answer {
    Yes,
    No,
}

impl ImportArguments {
    /// Whether the path is a trace: no folder of a run, or said to be a trace.
    pub(super) fn are_for(&self, path: &Path) -> bool {
        let is_there = path.exists() && !path.is_dir();
        path.as_os_str() == STANDARD_INPUT || is_there || self.import.is_some()
    }

    /// Nothing of this is said of a recording.
    pub(super) fn check_absent(&self) -> Result<(), Failure> {
        let Self { import, ignore_object_size, .. } = self;
        if import.is_some() || *ignore_object_size || self.csv() != CsvOptions::default() {
            let what =
                "--import, --ignore-object-size and --csv-… are of a trace that came from elsewhere: expected a file";
            return Err(Failure::bad_input(what));
        }
        Ok(())
    }

    /// Reads a trace for lines of `line_bytes` or more.
    pub(super) fn import(&self, path: &Path, line_bytes: u32) -> Result<Imported, Failure> {
        let options = ImportOptions { format: self.import, csv: self.csv(), line_bytes_min: line_bytes };
        let imported = importers::import(path, &options)?;
        if self.ignore_object_size && !imported.is_of_objects() {
            return Err(Failure::bad_input(
                "--ignore-object-size: a trace of bytes has no objects, expected one of objects",
            ));
        }
        print_notes(&imported.notes());
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
}

/// What of a trace is not simulated as it is.
fn print_notes(notes: &Notes) {
    let Notes { references: _, writes, copy_backs, invalidations, left_out, resized, unknown_operations } = *notes;
    for (count, what) in [
        (writes, "writes count as reads"),
        (copy_backs, "copy backs are not simulated"),
        (invalidations, "invalidations are not simulated"),
        (left_out, "references to nothing, of size 0, are left out"),
        (resized, "references to objects have another size than at first, which is the one that counts"),
        (unknown_operations, "references with an operation that is not known count as reads"),
    ] {
        if count > 0 {
            outlet::say(format_args!("note: {count} {what}"));
        }
    }
}
