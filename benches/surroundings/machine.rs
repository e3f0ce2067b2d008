//! What a trial must leave as it was.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// A line each: the devices that everything uses, the mounts, the control groups of trials.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Machine(BTreeSet<String>);

/// As they are made in a private /dev: name and number.
pub(crate) const DEVICES: [(&str, u64, u64); 6] =
    [("null", 1, 3), ("zero", 1, 5), ("full", 1, 7), ("random", 1, 8), ("urandom", 1, 9), ("tty", 5, 0)];

impl Machine {
    pub(crate) fn now() -> Self {
        // The mounts of this process' main thread: a trial's thread has others.
        let mounts = fs::read_to_string("/proc/self/mountinfo").expect("Linux has /proc/self/mountinfo");
        // A mount's fields beyond its options change without us.
        let mounts = mounts.lines().map(|line| line.split(' ').take(6).collect::<Vec<_>>().join(" "));
        let mut lines: BTreeSet<String> = devices().into_iter().chain(mounts).collect();
        add_groups(Path::new("/sys/fs/cgroup"), &mut lines);
        Self(lines)
    }

    /// Since `before`.
    pub(crate) fn changes(&self, before: &Self) -> Vec<String> {
        let gone = before.0.difference(&self.0).map(|line| format!("gone: {line}"));
        gone.chain(self.0.difference(&before.0).map(|line| format!("new: {line}"))).collect()
    }
}

pub(crate) fn devices() -> Vec<String> {
    let line = |(name, ..): (&str, u64, u64)| match fs::symlink_metadata(format!("/dev/{name}")) {
        Ok(found) => format!("/dev/{name}: mode {:o}, device {:x}", found.mode(), found.rdev()),
        Err(error) => format!("/dev/{name}: {error}"),
    };
    DEVICES.map(line).into()
}

/// Of the control group that a trial of this process makes.
pub(crate) fn group_name() -> String {
    format!("marti-surroundings-{}", std::process::id())
}

fn add_groups(folder: &Path, lines: &mut BTreeSet<String>) {
    // Without control groups there are none to leave behind.
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten().filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir())) {
        // Others make groups of their own at any time, another campaign among them.
        if entry.file_name() == *group_name() {
            lines.insert(entry.path().display().to_string());
        }
        add_groups(&entry.path(), lines);
    }
}
