//! `marti schema topology|report`

use clap::{Args, ValueEnum};

use super::{Failure, print};
use cluster::{report, topology};

/// Print the JSON schema of a file format
#[derive(Clone, Debug, Args)]
pub struct SchemaArguments {
    #[arg(value_enum)]
    pub format: Format,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// A topology file
    Topology,
    /// The report.json of a run
    Report,
}

pub(super) fn schema(arguments: &SchemaArguments) -> Result<(), Failure> {
    let schema = match arguments.format {
        Format::Topology => topology::schema::json(),
        Format::Report => report::schema::json(),
    };
    print(&schema.map_err(|error| Failure::failed(error.to_string()))?)
}
