//! A control group with little memory, of either version.

use std::fs;
use std::path::PathBuf;

use crate::machine::group_name;

/// Removed when it is dropped; its processes must have ended.
pub(crate) struct MemoryGroup {
    pub(crate) folder: PathBuf,
    /// What says how often the limit was met.
    counters: [&'static str; 2],
}

impl MemoryGroup {
    /// # Errors
    /// Why there can be none here.
    pub(crate) fn new(bytes: u64) -> Result<Self, String> {
        let name = group_name();
        let first = PathBuf::from("/sys/fs/cgroup/memory");
        let (root, limit, counters) = if first.is_dir() {
            (first, "memory.limit_in_bytes", ["memory.failcnt", "memory.oom_control"])
        } else {
            (PathBuf::from("/sys/fs/cgroup"), "memory.max", ["memory.events", "memory.events"])
        };
        let group = Self { folder: root.join(name), counters };
        let failed = |error: std::io::Error| format!("{}: {error}", group.folder.display());
        fs::create_dir(&group.folder).map_err(failed)?;
        fs::write(group.folder.join(limit), bytes.to_string()).map_err(failed)?;
        Ok(group)
    }

    /// How the limit was met, if it was.
    pub(crate) fn effect(&self) -> Option<String> {
        let told = self.counters.map(|name| fs::read_to_string(self.folder.join(name)).unwrap_or_default());
        let count = |line: &str| line.split(' ').next_back().and_then(|number| number.parse::<u64>().ok());
        let met = |line: &&str| !line.contains("low") && !line.contains("disable") && count(line) > Some(0);
        let lines: Vec<&str> = told.iter().flat_map(|text| text.lines()).filter(met).collect();
        (!lines.is_empty()).then(|| format!("memory group: refused or killed: {}", lines.join(" ")))
    }
}

impl Drop for MemoryGroup {
    fn drop(&mut self) {
        // If it stays, the machine is found changed.
        let _ = fs::remove_dir(&self.folder);
    }
}
