//! What a schema says of its recording: words under keys that begin with `marti.`.

use std::collections::HashMap;

use ground::ids::Epoch;
use trace::database::{Layout, Section};

/// What both kinds of recordings say, and their own.
pub(super) fn entries<const N: usize>(
    format_version: u32,
    epoch: Epoch,
    layout: &Layout,
    own: [(&str, String); N],
) -> HashMap<String, String> {
    let common = [
        ("marti.format_version", format_version.to_string()),
        ("marti.version", env!("CARGO_PKG_VERSION").to_owned()),
        ("marti.epoch", epoch.0.to_string()),
        ("marti.image_bytes", layout.database_bytes().to_string()),
        ("marti.records", records_json(layout)),
    ];
    common.into_iter().chain(own).map(|(key, value)| (key.to_owned(), value)).collect()
}

/// Records of each section: JSON.
pub(super) fn records_json(layout: &Layout) -> String {
    let records = Section::ALL.map(|section| format!(r#""{}": {}"#, section.name(), layout.span(section).records));
    format!("{{{}}}", records.join(", "))
}
