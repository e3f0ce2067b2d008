//! What a scene file says that is repaired or left out, and where.

use std::fmt;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SourceError;

/// Something of a file that does not change the geometry: it is repaired or left out, and the scene is rendered.
/// Prints as `FILE:LINE:COL: what (and N more)`.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize, JsonSchema)]
pub struct Warning {
    /// `None` for what is about the scene as a whole.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub file: Option<PathBuf>,
    /// Of the first of its kind, from 1; `None` when it is about the file as a whole.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub line: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub column: Option<u32>,
    /// What programs tell warnings apart by: lower case words and hyphens.
    pub kind: String,
    /// How many of this kind the file has.
    pub count: u64,
    /// The first of its kind: what is wrong, and how it is repaired.
    pub text: String,
}

impl Warning {
    /// A warning about the scene as a whole.
    pub fn of_scene(kind: &str, text: impl Into<String>) -> Self {
        Self { file: None, line: None, column: None, kind: kind.to_owned(), count: 1, text: text.into() }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}:", file.display())?;
            if let (Some(line), Some(column)) = (self.line, self.column) {
                write!(f, "{line}:{column}:")?;
            }
            f.write_str(" ")?;
        }
        f.write_str(&self.text)?;
        if self.count > 1 { write!(f, " (and {} more)", self.count - 1) } else { Ok(()) }
    }
}

/// The warnings of a scene, one of each kind and file.
#[derive(Clone, Default, PartialEq, Debug)]
pub struct Warnings(Vec<Warning>);

impl Warnings {
    /// Counts one more of its kind; only the first of a kind and file is made into words.
    pub fn add(&mut self, file: &Path, kind: &'static str, first: impl FnOnce() -> SourceError) {
        let is_same = |warning: &&mut Warning| warning.kind == kind && warning.file.as_deref() == Some(file);
        if let Some(warning) = self.0.iter_mut().find(is_same) {
            warning.count += 1;
            return;
        }
        let SourceError { file, place, what } = first();
        self.0.push(Warning {
            file: Some(file),
            line: place.map(|(line, _)| line),
            column: place.map(|(_, column)| column),
            kind: kind.to_owned(),
            count: 1,
            text: what,
        });
    }

    /// Adds one that is the only one of its kind.
    pub fn push(&mut self, warning: Warning) {
        self.0.push(warning);
    }

    pub fn extend(&mut self, others: impl IntoIterator<Item = Warning>) {
        self.0.extend(others);
    }

    /// In the order in which their kinds came first.
    pub fn all(&self) -> &[Warning] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_a_kind_and_file_is_shown_and_the_others_are_counted() {
        let (a, b) = (Path::new("a.obj"), Path::new("b.mtl"));
        let mut warnings = Warnings::default();
        for line in 1..=3 {
            warnings.add(a, "short-face", || SourceError::new(a, Some((line, 2)), "\"f\" with 2 corners, is left out"));
        }
        warnings.add(b, "short-face", || SourceError::new(b, None, "is empty"));
        warnings.push(Warning::of_scene("nothing-drawn", "the scene has no primitives"));
        let lines: Vec<_> = warnings.all().iter().map(Warning::to_string).collect();
        assert_eq!(
            lines,
            [
                "a.obj:1:2: \"f\" with 2 corners, is left out (and 2 more)",
                "b.mtl: is empty",
                "the scene has no primitives"
            ]
        );
    }
}
