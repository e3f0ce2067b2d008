//! The report of a run or of a rendering, as it is printed at the end.

use std::io;

use super::options::TextOrJson;
use super::{Failure, json, print};
use cluster::report::{Report, text};
use ground::colour;

/// Its summary, or all of it.
pub(super) fn print_report(report: &Report, format: TextOrJson) -> Result<(), Failure> {
    print(&match format {
        TextOrJson::Text => colour::summary(&text::summary(report), &io::stdout()),
        TextOrJson::Json => json(report)?,
    })
}
