//! report.json.

use std::io::{self, BufReader, Write};
use std::path::Path;

use super::Report;
use ground::atomic_file;
use ground::regular_file;

/// Writes the report, there whole or not at all.
///
/// # Errors
/// The file cannot be written; the error names it.
pub fn write(report: &Report, path: &Path) -> io::Result<()> {
    atomic_file::write(path, |file| {
        serde_json::to_writer_pretty(&mut *file, report)?;
        file.write_all(b"\n")
    })
}

/// Reads a report back.
///
/// # Errors
/// The file cannot be read, is no regular file, or is no report; the error names it.
pub fn read(path: &Path) -> io::Result<Report> {
    let read = || Ok(serde_json::from_reader(BufReader::new(regular_file::open(path)?))?);
    read().map_err(|error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}

/// Whether a file begins as a report of any version.
pub fn is_report(path: &Path) -> bool {
    #[derive(serde::Deserialize)]
    struct Versioned {
        #[serde(rename = "schema_version")]
        _version: u32,
    }
    let versioned = regular_file::open(path).ok().map(|file| serde_json::from_reader(BufReader::new(file)));
    matches!(versioned, Some(Ok(Versioned { .. })))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;
    use crate::report::fixture;

    fn keys(value: &Value, found: &mut BTreeSet<String>) {
        match value {
            Value::Object(fields) => fields.iter().for_each(|(key, value)| {
                found.insert(key.clone());
                keys(value, found);
            }),
            Value::Array(values) => values.iter().for_each(|value| keys(value, found)),
            _ => {}
        }
    }

    #[test]
    fn a_report_reads_back() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("report.json");
        // Without the ratios: serde_json reads such fractions to within the last bit only.
        let report = Report { memory: None, ..fixture::report() };
        write(&report, &path).expect("writable folder");
        let text = std::fs::read_to_string(&path).expect("written");
        assert_eq!(serde_json::from_str::<Report>(&text).expect("a report"), report);
    }

    #[test]
    fn every_key_is_documented() {
        let documentation = include_str!("../../../docs/report.md");
        // `key` or `part.key`.
        let documented = |key: &str| ["`", "."].iter().any(|before| documentation.contains(&format!("{before}{key}`")));
        let mut found = BTreeSet::new();
        keys(&serde_json::to_value(fixture::report()).expect("plain data"), &mut found);
        let missing: Vec<_> = found.iter().filter(|key| !documented(key)).collect();
        assert!(missing.is_empty(), "docs/report.md does not say what these are: {missing:?}");
    }
}
