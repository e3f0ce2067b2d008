//! The code map of ARCHITECTURE.md, and what it and the pages on extensions name, against the code.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use crate::source::SourceFile;
use crate::{LAYERS, LIBRARY, project};

pub(crate) type CodeMap = BTreeMap<String, Vec<String>>;

/// Words between backticks.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Rows of the table: modules, and the others that each may name.
fn rows(architecture: &str) -> impl Iterator<Item = (Vec<String>, Vec<String>)> {
    architecture.lines().filter(|line| line.starts_with("| `")).filter_map(|row| {
        let columns: Vec<&str> = row.trim_matches('|').split('|').collect();
        let [modules, _, may_know] = columns[..] else { return None };
        Some((quoted(modules).map(str::to_owned).collect(), quoted(may_know).map(str::to_owned).collect()))
    })
}

/// The modules, and the others that each may name.
pub(crate) fn code_map(architecture: &str) -> CodeMap {
    let mut map = BTreeMap::new();
    for (modules, may_know) in rows(architecture) {
        for module in modules {
            let others = may_know.iter().filter(|other| **other != module).cloned().collect();
            map.insert(module, others);
        }
    }
    map
}

/// Permissions to know a module of a later row: the map is from the ground up.
pub(crate) fn downward(architecture: &str) -> Vec<String> {
    let (mut above, mut found) = (BTreeSet::new(), Vec::new());
    for (modules, may_know) in rows(architecture) {
        above.extend(modules.iter().cloned());
        let later = may_know.iter().filter(|known| !above.contains(*known));
        found
            .extend(later.map(|known| format!("`{}` may know `{known}`, which is not above it", modules.join("`, `"))));
    }
    found
}

/// Those that the code map has: the layer, and the module.
type Modules<'a> = BTreeSet<&'a [String]>;

fn modules(files: &[SourceFile]) -> Modules<'_> {
    files.iter().filter_map(|file| file.module.get(..2)).collect()
}

/// Modules of the layers that a file's names are in, other than its own: each with a name and its line.
fn named<'a>(modules: &'a Modules<'_>, file: &'a SourceFile) -> impl Iterator<Item = (&'a str, String)> {
    let own = file.module.get(1);
    let names = file.names.iter().filter(|name| name.path.len() > 1 && modules.contains(&name.path[..2]));
    let others = names.filter(move |name| Some(&name.path[1]) != own);
    others.map(|name| (name.path[1].as_str(), format!("{}:{} names `{name}`", file.path.display(), name.line)))
}

/// Names of modules of the layers that the code map does not allow where they are.
pub(crate) fn upward(files: &[SourceFile], map: &CodeMap) -> Vec<String> {
    let (modules, mut found) = (modules(files), Vec::new());
    for file in files {
        let Some(own) = file.module.get(1) else { continue };
        let Some(allowed) = map.get(own) else {
            found.push(format!("{}: `{own}` is not in the code map", file.path.display()));
            continue;
        };
        let others = named(&modules, file).filter(|(module, _)| !allowed.iter().any(|other| other == module));
        found.extend(others.map(|(_, what)| what));
    }
    found
}

/// Permissions that nothing uses.
pub(crate) fn unused(files: &[SourceFile], map: &CodeMap) -> Vec<String> {
    let (modules, mut used) = (modules(files), BTreeSet::new());
    for file in files.iter().filter(|file| file.module.len() > 1) {
        used.extend(named(&modules, file).map(|(other, _)| (file.module[1].as_str(), other)));
    }
    let permissions = map.iter().flat_map(|(module, known)| known.iter().map(move |other| (module, other)));
    let unused = permissions.filter(|(module, other)| !used.contains(&(module.as_str(), other.as_str())));
    unused.map(|(module, other)| format!("`{module}` may know `{other}`, and does not")).collect()
}

fn architecture() -> String {
    fs::read_to_string(project().join("ARCHITECTURE.md")).expect("a file")
}

#[test]
fn a_module_names_those_that_the_code_map_allows() {
    let architecture = architecture();
    let map = code_map(&architecture);
    let found = upward(&LIBRARY, &map);
    assert!(found.is_empty(), "the code map of ARCHITECTURE.md does not allow it:\n{}", found.join("\n"));
    let found = [downward(&architecture), unused(&LIBRARY, &map)].concat();
    assert!(found.is_empty(), "the code map of ARCHITECTURE.md:\n{}", found.join("\n"));
    for module in map.iter().flat_map(|(module, known)| known.iter().chain([module])) {
        let exists = LIBRARY.iter().any(|file| file.module.get(1) == Some(module));
        assert!(exists, "the code map names `{module}`, which is no module");
    }
    let mut order: Vec<&str> = Vec::new();
    let mut layer = None;
    for line in architecture.lines() {
        let heading = LAYERS.iter().find(|layer| line.contains(&format!("**{}**", capitalised(layer))));
        layer = heading.or(layer);
        for module in code_map(line).keys() {
            let folder = Path::new("src").join(layer.expect("a heading before the first row"));
            let is_there =
                LIBRARY.iter().any(|file| file.module.get(1) == Some(module) && file.path.starts_with(&folder));
            assert!(is_there, "the code map has `{module}` in {}, where it is not", folder.display());
        }
    }
    // Whatever may be known can be put below: the map itself has no circle.
    while order.len() < map.len() {
        let next = map.iter().find(|(module, known)| {
            !order.contains(&module.as_str())
                && known.iter().all(|known| order.contains(&known.as_str()) || !map.contains_key(known))
        });
        order.push(next.unwrap_or_else(|| panic!("the code map has a circle above {order:?}")).0);
    }
}

fn capitalised(word: &str) -> String {
    word[..1].to_uppercase() + &word[1..]
}

/// The paths that `a/{b,c}/d` is short for.
fn expanded(name: &str) -> Vec<String> {
    let Some((before, rest)) = name.split_once('{') else { return vec![name.to_owned()] };
    let Some((choices, after)) = rest.split_once('}') else { return vec![name.to_owned()] };
    choices.split(',').flat_map(|choice| expanded(&format!("{before}{}{after}", choice.trim()))).collect()
}

/// What a page names between backticks and is not there: files and folders from the root of the project or from any folder in
/// it (`database/records.rs`, `replay/contention`), and paths of modules and of what is in them (`tracer::tile`).
pub(crate) fn missing(text: &str, paths: &[PathBuf], files: &[SourceFile]) -> Vec<String> {
    let is_path = |name: &&str| name.contains('/') || name.contains("::") || name.ends_with(".rs");
    let is_plain = |name: &&str| {
        name.chars().all(|c| c.is_alphanumeric() || matches!(c, '/' | '_' | '-' | '.' | ':' | '{' | '}' | ',' | ' '))
    };
    // A command, a folder that a run writes, or a name of the standard library.
    let is_other =
        |name: &str| name.contains(' ') && !name.contains('{') || name.starts_with("OUT/") || name.starts_with("std::");
    let names = quoted(text).filter(is_path).filter(is_plain).filter(|name| !is_other(name));
    let missing = names.flat_map(expanded).filter(|name| {
        if name.contains("::") { !is_named(name, files) } else { !is_file(name.trim_end_matches('/'), paths) }
    });
    missing.collect()
}

fn is_file(name: &str, paths: &[PathBuf]) -> bool {
    let with_extension = format!("{name}.rs");
    paths.iter().any(|path| path.ends_with(name) || path.ends_with(&with_extension))
}

/// Whether modules, or a module and what is defined or imported in it, have these names in a row.
fn is_named(name: &str, files: &[SourceFile]) -> bool {
    let parts: Vec<String> = name.split("::").map(str::to_owned).collect();
    // What is in a type is not looked for.
    let length = parts.iter().position(|part| part.starts_with(char::is_uppercase)).map_or(parts.len(), |i| i + 1);
    let parts = &parts[..length];
    files.iter().any(|file| {
        let imported = file.imports.iter().filter(|import| import.shown != "*");
        let imported = imported.map(|import| [&import.of.scope[..], std::slice::from_ref(&import.shown)].concat());
        file.module.ends_with(parts) || file.items.iter().cloned().chain(imported).any(|path| path.ends_with(parts))
    })
}

/// Files and folders of the project, from its root.
fn project_paths() -> Vec<PathBuf> {
    let mut paths = Vec::new();
    let roots = ["bin", "src", "tests", "examples", "docs", "fuzz", "benches", "scenes"];
    let mut rest: Vec<PathBuf> = roots.into_iter().map(PathBuf::from).collect();
    while let Some(folder) = rest.pop() {
        let Ok(entries) = fs::read_dir(project().join(&folder)) else { continue };
        for entry in entries.map(|entry| entry.expect("an entry")).filter(|entry| entry.file_name() != "target") {
            let path = folder.join(entry.file_name());
            if entry.file_type().expect("a type").is_dir() {
                rest.push(path.clone());
            }
            paths.push(path);
        }
        paths.push(folder);
    }
    paths
}

#[test]
fn files_and_modules_that_the_documentation_names_exist() {
    let paths = project_paths();
    let pages =
        fs::read_dir(project().join("docs/extending")).expect("a folder").map(|page| page.expect("an entry").path());
    for page in pages.chain([project().join("ARCHITECTURE.md")]) {
        let text = fs::read_to_string(&page).expect("a file");
        let found = missing(&text, &paths, &LIBRARY);
        assert!(found.is_empty(), "{} names what is not there: {found:?}", page.display());
    }
}
