//! `marti replay RECORDING --contention`: how many nodes a bus carries.

use crate::cli::grid_options::SETTINGS;
use crate::cli::table::{Format, Table};
use crate::cli::{Failure, json, print};
use ground::progress::Parts;
use machine::replay::contention::table::contention_table;
use machine::replay::plan::setting::Setting;
use machine::replay::stream::subject::Subject;

/// Numbers of nodes where none are asked for.
pub(super) const NODES: [u16; 9] = [1, 2, 4, 8, 16, 32, 64, 128, 256];

pub(super) fn print_contention<S: Subject>(
    subject: &S,
    settings: &[Setting],
    format: Format,
    quiet: bool,
) -> Result<(), Failure> {
    let [first, rest @ ..] = settings else { return Ok(()) };
    if rest.iter().any(|other| Setting { nodes: first.nodes, assignment: first.assignment, ..*other } != *first) {
        return Err(Failure::bad_input("--contention takes a list of --nodes and one value of everything else"));
    }
    let parts = Parts::new(quiet, "numbers of nodes");
    let table = contention_table(subject, settings, |all| parts.done(all))
        .map_err(|error| Failure::bad_input(error.to_string()))?;
    parts.clear();
    if format == Format::Json {
        return print(&json(&table)?);
    }
    print(&Table::new(&table.rows)?.print(format, &SETTINGS))?;
    if format == Format::Text {
        let number = |nodes: Option<u16>| nodes.map_or("none of these".to_owned(), |nodes| nodes.to_string());
        print(&format!(
            "\nlargest number of nodes at 90% efficiency: {} simulated, {} by the formula\n",
            number(table.largest_efficient),
            number(table.largest_efficient_formula)
        ))?;
        if let Some(reason) = table.rows.iter().find_map(|row| row.reason) {
            print(&format!("\napproximate: {reason}\n"))?;
        }
    }
    Ok(())
}
