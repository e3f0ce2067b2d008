//! The graph of the files of all layers: which takes names from which.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::source::SourceFile;

/// Files by module, and the arrows between them.
pub(crate) struct Imports<'a> {
    files: BTreeMap<Vec<String>, &'a SourceFile>,
}

impl<'a> Imports<'a> {
    pub(crate) fn of(files: &'a [SourceFile]) -> Self {
        Self { files: files.iter().map(|file| (file.module.clone(), file)).collect() }
    }

    /// The file that a path leads to; `None`: not to a file of the layers.
    fn target(&self, path: &[String]) -> Option<&'a SourceFile> {
        (1..=path.len()).rev().find_map(|length| self.files.get(&path[..length]).copied())
    }

    /// Which files each file takes names from. A module and those in it are one house: what they take from each other is no
    /// arrow.
    pub(crate) fn arrows(&self) -> BTreeMap<&'a Path, BTreeSet<&'a Path>> {
        let mut arrows: BTreeMap<&Path, BTreeSet<&Path>> = BTreeMap::new();
        for file in self.files.values() {
            let to = arrows.entry(&file.path).or_default();
            let names = file.names.iter().filter(|name| !name.leads_on);
            let targets = names.filter_map(|name| self.target(&name.path));
            let is_apart =
                |to: &&SourceFile| !to.module.starts_with(&file.module) && !file.module.starts_with(&to.module);
            to.extend(targets.filter(is_apart).map(|target| &*target.path));
        }
        arrows
    }
}

/// Sets of files that take names from each other in a circle, each in order (Tarjan's strongly connected components).
pub(crate) fn cycles(arrows: &BTreeMap<&Path, BTreeSet<&Path>>) -> Vec<Vec<PathBuf>> {
    // Small enough for the plain way: two files are in one cycle if each reaches the other.
    let reached: BTreeMap<&Path, BTreeSet<&Path>> = arrows
        .keys()
        .map(|&start| {
            let (mut seen, mut rest) = (BTreeSet::new(), vec![start]);
            while let Some(file) = rest.pop() {
                rest.extend(arrows.get(file).into_iter().flatten().filter(|to| seen.insert(**to)));
            }
            (start, seen)
        })
        .collect();
    let mut cycles = BTreeSet::new();
    for (file, to) in &reached {
        if to.contains(file) {
            let members = to.iter().filter(|other| reached.get(**other).is_some_and(|back| back.contains(file)));
            cycles.insert(members.map(|path| path.to_path_buf()).collect::<Vec<_>>());
        }
    }
    cycles.into_iter().collect()
}
