//! Where names lead: through imports, globs and re-exports to what they name.

use std::collections::{BTreeMap, BTreeSet};

use crate::source::{Name, SourceFile, Written};

/// Paths that one name leads to, and modules that one glob leads through; more than any in the code.
const PATHS_MAX: usize = 64;
const GLOBS_MAX: usize = 8;

type Path = Vec<String>;

/// What all files define and import.
struct Known {
    /// The layers' names.
    roots: BTreeSet<String>,
    modules: BTreeSet<Path>,
    items: BTreeSet<Path>,
    /// By the path under which an import can be named.
    imports: BTreeMap<Path, BTreeSet<Path>>,
    /// By module: those whose names are all visible in it.
    globs: BTreeMap<Path, BTreeSet<Path>>,
}

/// Fills in the names of all files: each path as it is written, and every path that it leads to.
pub(crate) fn resolve(mut files: Vec<SourceFile>) -> Vec<SourceFile> {
    let known = Known::of(&files);
    for file in &mut files {
        file.names = file.written.iter().flat_map(|written| known.names(written)).collect();
    }
    files
}

impl Known {
    fn of(files: &[SourceFile]) -> Self {
        let mut known = Self {
            roots: files.iter().map(|file| file.module[0].clone()).collect(),
            modules: files.iter().map(|file| file.module.clone()).collect(),
            items: files.iter().flat_map(|file| file.items.iter().cloned()).collect(),
            imports: BTreeMap::new(),
            globs: BTreeMap::new(),
        };
        let imports = || files.iter().flat_map(|file| &file.imports);
        for import in imports().filter(|import| import.shown != "*") {
            let shown = [&import.of.scope[..], std::slice::from_ref(&import.shown)].concat();
            known.imports.entry(shown).or_default();
        }
        // A path may begin with what another `use` of its module shows.
        for import in imports() {
            let of = known.absolute(&import.of);
            if import.shown == "*" {
                known.globs.entry(import.of.scope.clone()).or_default().insert(of);
            } else {
                let shown = [&import.of.scope[..], std::slice::from_ref(&import.shown)].concat();
                known.imports.entry(shown).or_default().insert(of);
            }
        }
        known
    }

    fn is_defined(&self, path: &[String]) -> bool {
        self.modules.contains(path) || self.items.contains(path) || self.imports.contains_key(path)
    }

    /// Whether a path names something, in its module or in one whose names are all visible there.
    fn is_visible(&self, path: &[String], globs: usize) -> bool {
        self.is_defined(path) || globs > 0 && !self.through_globs(path, path.len() - 1, globs).is_empty()
    }

    /// Where a path leads whose first `module` parts are a module that has globs.
    fn through_globs(&self, path: &[String], module: usize, globs: usize) -> Vec<Path> {
        let (module, rest) = path.split_at(module);
        if rest.is_empty() || self.is_defined(&path[..=module.len()]) {
            return Vec::new();
        }
        let visible = self.globs.get(module).into_iter().flatten().filter(|of| {
            let first = [&of[..], &rest[..1]].concat();
            self.is_visible(&first, globs - 1)
        });
        visible.map(|of| [of, rest].concat()).collect()
    }

    /// A path that does not begin with a keyword begins with a name of its own module, or else of a crate.
    fn absolute(&self, written: &Written) -> Path {
        if written.is_rooted {
            return written.path.clone();
        }
        let local = [&written.scope[..], &written.path[..]].concat();
        let is_local = self.is_visible(&local[..=written.scope.len()], GLOBS_MAX);
        if is_local { local } else { written.path.clone() }
    }

    fn names(&self, written: &Written) -> Vec<Name> {
        let first = self.absolute(written);
        // A word by itself is not a path; what it is was named where it was imported, unless by a glob.
        if written.path.len() == 1 && (first.len() == 1 || self.is_defined(&first)) {
            return Vec::new();
        }
        let (mut names, mut seen, mut rest) = (Vec::new(), BTreeSet::from([first.clone()]), vec![first]);
        while let Some(path) = rest.pop() {
            let next = self.next(&path);
            let is_ours = |path: &Path| self.roots.contains(&path[0]);
            let leads_on = next.iter().any(is_ours);
            rest.extend(next.into_iter().filter(|path| seen.len() < PATHS_MAX && seen.insert(path.clone())));
            names.push(Name { path, line: written.line, leads_on });
        }
        names
    }

    /// Where a path leads in one step.
    fn next(&self, path: &[String]) -> Vec<Path> {
        let mut next = Vec::new();
        for length in 1..=path.len() {
            let (shown, rest) = path.split_at(length);
            for of in self.imports.get(shown).into_iter().flatten() {
                // `pub use load::load` of a module with a function of its name: what is in the module is not in the function.
                if !of.starts_with(shown) || rest.is_empty() && of != shown {
                    next.push([of, rest].concat());
                }
            }
            next.extend(self.through_globs(path, length, GLOBS_MAX));
        }
        next
    }
}
