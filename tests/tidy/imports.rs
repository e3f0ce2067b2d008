//! The graph of the files of all layers: which takes names from which.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::source::SourceFile;

/// Re-exports that are followed from one name; more than any chain in the code.
const EXPORTS_MAX: usize = 8;

/// Files by module, and the arrows between them.
pub(crate) struct Imports<'a> {
    files: BTreeMap<Vec<String>, &'a SourceFile>,
}

impl<'a> Imports<'a> {
    pub(crate) fn of(files: &'a [SourceFile]) -> Self {
        Self { files: files.iter().map(|file| (file.module.clone(), file)).collect() }
    }

    /// The file that a name of `from` leads to; `None`: not to a file of this crate.
    pub(crate) fn target(&self, from: &SourceFile, path: &[String]) -> Option<&'a SourceFile> {
        let mut path = path.to_vec();
        let child = [&from.module[..], &path[..1]].concat();
        if self.files.contains_key(&child) {
            path = [&from.module[..], &path[..]].concat();
        }
        for _ in 0..EXPORTS_MAX {
            let (module, file) = (1..=path.len()).rev().find_map(|length| self.files.get_key_value(&path[..length]))?;
            let next = path.get(module.len())?;
            let Some(exported) = file.exports.get(next) else { return Some(file) };
            let exported = [&exported[..], &path[module.len() + 1..]].concat();
            // A crate's that is none of the layers.
            let is_ours = |first: &String| self.files.contains_key(std::slice::from_ref(first));
            if !exported.first().is_some_and(is_ours) {
                return Some(file);
            }
            // `pub use self::inner::Thing` of a module that is named as the thing would go on for ever.
            if exported == path {
                return Some(file);
            }
            path = exported;
        }
        None
    }

    /// Which files each file takes names from. A module and those in it are one house: what they take from each other is no
    /// arrow.
    pub(crate) fn arrows(&self) -> BTreeMap<&'a Path, BTreeSet<&'a Path>> {
        let mut arrows: BTreeMap<&Path, BTreeSet<&Path>> = BTreeMap::new();
        for file in self.files.values() {
            let to = arrows.entry(&file.path).or_default();
            let targets = file.names.iter().filter_map(|name| self.target(file, &name.path));
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
