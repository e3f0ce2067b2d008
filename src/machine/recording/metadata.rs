//! What a schema says of its recording: words under keys that begin with `marti.`.

use std::collections::{BTreeMap, HashMap};

use ground::ids::Epoch;
use trace::database::strides::Strides;
use trace::database::{Layout, Section};

/// The newest version of both formats, which says how far records are apart and may have polygons among them. It is written
/// where they are or do; all else is of version 1, as ever.
pub(super) const FORMAT_VERSION: u32 = 2;

/// The version in which a recording of this database is written.
pub(super) fn format_version(layout: &Layout) -> u32 {
    if layout.is_plain() { 1 } else { FORMAT_VERSION }
}

/// Whether a version, as it is written, can be read.
pub(super) fn is_known_version(version: &str) -> bool {
    (1..=FORMAT_VERSION).any(|known| version == known.to_string())
}

/// What both kinds of recordings say, and their own.
pub(super) fn entries<const N: usize>(
    epoch: Epoch,
    layout: &Layout,
    own: [(&str, String); N],
) -> HashMap<String, String> {
    let common = [
        ("marti.format_version", format_version(layout).to_string()),
        ("marti.version", env!("CARGO_PKG_VERSION").to_owned()),
        ("marti.epoch", epoch.0.to_string()),
        ("marti.image_bytes", layout.database_bytes().to_string()),
        (RECORDS, json(&records(layout))),
    ];
    let strides = record_bytes(layout).map(|bytes| (RECORD_BYTES, json(&bytes)));
    common.into_iter().chain(strides).chain(own).map(|(key, value)| (key.to_owned(), value)).collect()
}

const RECORDS: &str = "marti.records";
const RECORD_BYTES: &str = "marti.record_bytes";

/// Records of each section, by name. Polygons are left out where there are none.
pub(super) fn records(layout: &Layout) -> Vec<(&'static str, u64)> {
    let count = |section: Section| (section.name(), layout.span(section).records);
    let is_named = |section: &Section| *section != Section::Polygons || layout.has_polygons();
    Section::ALL.into_iter().filter(is_named).map(count).collect()
}

/// Bytes of a record of each section, by name; `None` where they follow from the format.
pub(super) fn record_bytes(layout: &Layout) -> Option<Vec<(&'static str, u64)>> {
    let bytes = |section: Section| (section.name(), layout.record_bytes(section));
    (!layout.is_plain()).then(|| Section::ALL.map(bytes).to_vec())
}

fn json(numbers: &[(&str, u64)]) -> String {
    let pairs: Vec<String> = numbers.iter().map(|(name, number)| format!(r#""{name}": {number}"#)).collect();
    format!("{{{}}}", pairs.join(", "))
}

/// The layout of so many records, by the names of sections, with records of so many bytes if that is said.
pub(super) fn layout<M: Named>(records: &M, record_bytes: Option<&M>) -> Result<Layout, String> {
    let mut counts = [0; Section::COUNT];
    let mut strides = Strides::CONTENT.bytes();
    for section in Section::ALL {
        let is_optional = section == Section::Polygons;
        let found = records.number(section.name()).or(is_optional.then_some(0));
        counts[section as usize] =
            found.ok_or_else(|| format!("expected the records of section {}", section.name()))?;
        if let Some(record_bytes) = record_bytes {
            let found = record_bytes.number(section.name());
            let found = found.ok_or_else(|| format!("expected the bytes of a record of section {}", section.name()))?;
            strides[section as usize] = u32::try_from(found).unwrap_or(u32::MAX);
        }
    }
    let strides = Strides::new(strides).map_err(|error| error.to_string())?;
    Layout::padded(counts, strides).map_err(|error| error.to_string())
}

/// Numbers by name.
pub(super) trait Named {
    fn number(&self, name: &str) -> Option<u64>;
}

impl Named for HashMap<String, u64> {
    fn number(&self, name: &str) -> Option<u64> {
        self.get(name).copied()
    }
}

impl Named for BTreeMap<String, u64> {
    fn number(&self, name: &str) -> Option<u64> {
        self.get(name).copied()
    }
}

/// The layout that a schema speaks of.
///
/// # Errors
/// It says nothing of one, or there is no such layout; the text names the entry.
pub(super) fn parse_layout<'a>(entry: impl Fn(&str) -> Option<&'a str>) -> Result<Layout, String> {
    let numbers = |key: &str, text: &str| {
        serde_json::from_str::<HashMap<String, u64>>(text).map_err(|error| format!("{key}: {error}"))
    };
    let counts = numbers(RECORDS, entry(RECORDS).ok_or_else(|| format!("the schema says nothing of {RECORDS}"))?)?;
    let bytes = entry(RECORD_BYTES).map(|text| numbers(RECORD_BYTES, text)).transpose()?;
    layout(&counts, bytes.as_ref()).map_err(|what| format!("{RECORDS}: {what}"))
}

/// Whether a schema speaks of just this layout.
pub(super) fn is_of_layout<'a>(layout: &Layout, entry: impl Fn(&str) -> Option<&'a str>) -> bool {
    let expected = |key: &str, value: Option<String>| entry(key) == value.as_deref();
    let strides = record_bytes(layout).map(|bytes| json(&bytes));
    expected(RECORDS, Some(json(&records(layout)))) && expected(RECORD_BYTES, strides)
}
