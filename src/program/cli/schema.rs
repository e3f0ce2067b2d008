//! `marti schema topology`

use clap::{Args, ValueEnum};

use super::{Failure, print};
use cluster::topology;

/// Print the JSON schema of a file format
#[derive(Clone, Debug, Args)]
pub struct SchemaArguments {
    #[arg(value_enum)]
    pub format: Format,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    Topology,
}

pub(super) fn schema(arguments: &SchemaArguments) -> Result<(), Failure> {
    let text = match arguments.format {
        Format::Topology => topology::schema::json().map_err(|error| Failure::failed(error.to_string()))?,
    };
    print(&text)
}
