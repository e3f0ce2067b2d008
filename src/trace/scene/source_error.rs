//! An error at a place in a file that a person wrote or chose.

use std::fmt;
use std::path::{Path, PathBuf};

/// Prints as `FILE:LINE:COL: what, expected what`.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SourceError {
    pub file: PathBuf,
    /// From 1; `None` when it is about the file as a whole.
    pub place: Option<(u32, u32)>,
    /// What is wrong, and after ", expected " what would be right.
    pub what: String,
}

impl SourceError {
    pub fn new(file: &Path, place: Option<(u32, u32)>, what: impl Into<String>) -> Self {
        Self { file: file.to_owned(), place, what: what.into() }
    }
}

impl fmt::Display for SourceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.file.display())?;
        if let Some((line, column)) = self.place {
            write!(f, "{line}:{column}:")?;
        }
        write!(f, " {}", self.what)
    }
}

impl std::error::Error for SourceError {}
