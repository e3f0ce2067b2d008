//! `marti replay TRACE` of a trace of objects: caches of so many bytes, whose objects have sizes of their own.

use serde::Serialize;

use crate::cli::table::{Format, Table};
use crate::cli::{Failure, print};
use ground::progress::Parts;
use machine::hardware::specification::MemorySize;
use machine::replay::importers::Imported;
use machine::replay::model::objects::{ObjectCounters, count_misses};
use machine::replay::parallel;
use machine::replay::plan::setting::{Policy, Setting};
use machine::replay::stream::subject::Subject;

/// A cache, and what it counted.
#[derive(Serialize)]
struct Row {
    local_memory: String,
    replacement: Policy,
    /// Capacity.
    local_bytes: u64,
    /// Different objects in the trace, and their bytes together.
    objects: u32,
    objects_bytes: u64,
    #[serde(flatten)]
    counters: ObjectCounters,
    misses_per_request: f64,
    bytes_missed_per_byte_requested: f64,
}

/// Columns that are the same in all rows as a rule.
const SETTINGS: [&str; 5] = ["local_memory", "replacement", "local_bytes", "objects", "objects_bytes"];

pub(super) fn print_objects(
    imported: &Imported,
    settings: &[Setting],
    format: Format,
    quiet: bool,
) -> Result<(), Failure> {
    let objects_bytes = u64::try_from(imported.objects_bytes().unwrap_or_default()).unwrap_or(u64::MAX);
    let capacity = |size| match size {
        MemorySize::All => objects_bytes,
        MemorySize::Share { numerator, denominator } => {
            (u128::from(objects_bytes) * u128::from(numerator) / u128::from(denominator)) as u64
        }
        MemorySize::Bytes(bytes) => bytes,
    };
    let parts = Parts::new(quiet, "caches");
    let rows = parallel::map(settings, |setting| {
        let local_bytes = capacity(setting.local_memory);
        let (policy, objects) = (setting.replacement, imported.objects());
        let counters = count_misses(policy, local_bytes, objects, imported.seed(), imported)?;
        parts.done(settings.len());
        Ok(Row {
            local_memory: setting.local_memory.to_string(),
            replacement: policy,
            local_bytes,
            objects,
            objects_bytes,
            misses_per_request: counters.object_miss_ratio(),
            bytes_missed_per_byte_requested: counters.byte_miss_ratio(),
            counters,
        })
    });
    parts.clear();
    let rows: Result<Vec<Row>, machine::replay::TraceError> = rows.into_iter().collect();
    let rows = rows.map_err(|error| Failure::bad_input(error.to_string()))?;
    print(&Table::new(&rows)?.print(format, &SETTINGS))
}
