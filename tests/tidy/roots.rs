//! The root files of the crates, in which nothing is written but what the crate has.

use std::fs;
use std::path::Path;

use syn::spanned::Spanned;

use crate::{LAYERS, project};

/// What the root file of a layer must not have: anything but modules in files of their own.
pub(crate) fn beyond_modules(text: &str) -> Vec<String> {
    let file = syn::parse_file(text).expect("a source file");
    let is_module = |item: &syn::Item| matches!(item, syn::Item::Mod(module) if module.content.is_none());
    let others = file.items.iter().filter(|item| !is_module(item));
    others.map(|item| format!("line {} is not a module", item.span().start().line)).collect()
}

/// What the library's root file must not have: anything but `pub use` of what is in a module of a layer or in another crate,
/// modules of these, and `compile_error!`.
pub(crate) fn beyond_re_exports(text: &str) -> Vec<String> {
    let file = syn::parse_file(text).expect("a source file");
    let mut found = Vec::new();
    file.items.iter().for_each(|item| re_export(item, &mut found));
    found
}

fn re_export(item: &syn::Item, found: &mut Vec<String>) {
    let line = item.span().start().line;
    match item {
        syn::Item::Use(item) if matches!(item.vis, syn::Visibility::Public(_)) => leaves(&item.tree, &[], line, found),
        syn::Item::Mod(syn::ItemMod { content: Some((_, items)), vis: syn::Visibility::Public(_), .. }) => {
            items.iter().for_each(|item| re_export(item, found));
        }
        syn::Item::Macro(item) if item.mac.path.is_ident("compile_error") => {}
        _ => found.push(format!("line {line} is not a re-export")),
    }
}

fn leaves(tree: &syn::UseTree, prefix: &[String], line: usize, found: &mut Vec<String>) {
    let with = |ident: &syn::Ident| [prefix, &[ident.to_string()]].concat();
    let path = match tree {
        syn::UseTree::Path(path) => return leaves(&path.tree, &with(&path.ident), line, found),
        syn::UseTree::Group(group) => return group.items.iter().for_each(|tree| leaves(tree, prefix, line, found)),
        syn::UseTree::Name(name) if name.ident == "self" => prefix.to_vec(),
        syn::UseTree::Name(name) => with(&name.ident),
        syn::UseTree::Rename(name) => with(&name.ident),
        syn::UseTree::Glob(_) => [prefix, &["*".to_owned()]].concat(),
    };
    let first = path[0].as_str();
    let is_layer_or_module = LAYERS.contains(&first) && path.len() < 3;
    if is_layer_or_module || matches!(first, "crate" | "self" | "super" | "std" | "core" | "alloc") {
        found.push(format!("line {line} re-exports `{}`", path.join("::")));
    }
}

#[test]
fn a_layer_s_root_has_modules_alone_and_the_library_s_has_re_exports_alone() {
    let read = |path: &Path| fs::read_to_string(project().join(path)).expect("a file");
    for layer in LAYERS {
        let root = Path::new("src").join(layer).join("lib.rs");
        assert_eq!(beyond_modules(&read(&root)), Vec::<String>::new(), "{}", root.display());
    }
    assert_eq!(beyond_re_exports(&read(Path::new("src/lib.rs"))), Vec::<String>::new(), "src/lib.rs");
}
