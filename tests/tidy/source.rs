//! What a source file of the program names: read by a parser, test modules left out wherever they are.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Span, TokenStream, TokenTree};
use syn::visit::{self, Visit};

/// A name in the code: the path of a module or of an item in it, and where it is written.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Name {
    /// Absolute. The first part is the name of its own layer, of another crate, of a local item or of something imported.
    pub(crate) path: Vec<String>,
    pub(crate) line: usize,
}

impl Name {
    /// Whether it is `prefix`, as in `std::fs`, or something in it.
    pub(crate) fn is_in(&self, prefix: &str) -> bool {
        let prefix: Vec<&str> = prefix.split("::").collect();
        self.path.len() >= prefix.len() && self.path.iter().zip(prefix).all(|(part, expected)| part == expected)
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.path.join("::"))
    }
}

/// One file, without its test modules.
#[derive(Clone, Debug)]
pub(crate) struct SourceFile {
    /// From the project's root.
    pub(crate) path: PathBuf,
    /// Its module, from its layer on.
    pub(crate) module: Vec<String>,
    pub(crate) names: Vec<Name>,
    /// Every single name in the code, macros with `!`, and methods of variables, as in `scope.spawn`.
    pub(crate) words: BTreeSet<String>,
    /// What `pub use` makes visible here: the name, and where it comes from.
    pub(crate) exports: BTreeMap<String, Vec<String>>,
    /// Lines outside test modules.
    pub(crate) lines: usize,
}

/// All files of the crate `name` whose root file is `root` (`src/trace/lib.rs`); what its test modules are is left out.
pub(crate) fn crate_files(project: &Path, name: &str, root: &Path) -> Vec<SourceFile> {
    let mut files = Vec::new();
    read(project, root, vec![name.to_owned()], &mut files);
    files
}

/// One file that is a crate of its own.
pub(crate) fn parse(text: &str, path: PathBuf, module: Vec<String>) -> (SourceFile, Vec<Vec<String>>) {
    let file = syn::parse_file(text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut reader = Reader {
        module: module.clone(),
        names: Vec::new(),
        words: BTreeSet::new(),
        exports: BTreeMap::new(),
        modules: Vec::new(),
        test_lines: 0,
        depth: 0,
    };
    reader.visit_file(&file);
    let lines = text.lines().count() - reader.test_lines.min(text.lines().count());
    let Reader { names, words, exports, modules, .. } = reader;
    (SourceFile { path, module, names, words, exports, lines }, modules)
}

fn read(project: &Path, path: &Path, module: Vec<String>, files: &mut Vec<SourceFile>) {
    let text = fs::read_to_string(project.join(path)).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let (source, modules) = parse(&text, path.to_owned(), module.clone());
    files.push(source);
    let is_folder = path.file_name().is_some_and(|name| name == "mod.rs" || name == "lib.rs");
    let folder = if is_folder { path.parent().expect("a file").to_owned() } else { path.with_extension("") };
    for inner in modules {
        // Modules within modules of the same file have folders of their own.
        let below = inner.iter().fold(folder.clone(), |folder, part| folder.join(part));
        let file =
            [below.with_extension("rs"), below.join("mod.rs")].into_iter().find(|file| project.join(file).is_file());
        let file = file.unwrap_or_else(|| panic!("{}: no file of its module {inner:?}", path.display()));
        read(project, &file, [module.clone(), inner].concat(), files);
    }
}

struct Reader {
    module: Vec<String>,
    names: Vec<Name>,
    words: BTreeSet<String>,
    exports: BTreeMap<String, Vec<String>>,
    /// Declared here and in files of their own: their paths from this file's module on.
    modules: Vec<Vec<String>>,
    test_lines: usize,
    /// Inline modules around what is visited.
    depth: usize,
}

/// Whether an item is compiled for tests alone.
fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    let names_test = |attribute: &syn::Attribute| {
        let syn::Meta::List(list) = &attribute.meta else { return false };
        let tokens: Vec<String> = list.tokens.clone().into_iter().map(|token| token.to_string()).collect();
        list.path.is_ident("cfg")
            && (tokens == ["test"]
                || tokens.first().is_some_and(|t| t == "all") && list.tokens.to_string().contains("test"))
    };
    attributes.iter().any(names_test)
}

fn attributes(item: &syn::Item) -> &[syn::Attribute] {
    match item {
        syn::Item::Const(item) => &item.attrs,
        syn::Item::Enum(item) => &item.attrs,
        syn::Item::Fn(item) => &item.attrs,
        syn::Item::Impl(item) => &item.attrs,
        syn::Item::Macro(item) => &item.attrs,
        syn::Item::Mod(item) => &item.attrs,
        syn::Item::Static(item) => &item.attrs,
        syn::Item::Struct(item) => &item.attrs,
        syn::Item::Trait(item) => &item.attrs,
        syn::Item::Type(item) => &item.attrs,
        syn::Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

impl Reader {
    /// Follows `crate`, `self` and `super`; `None`: a path of one part, which names nothing elsewhere.
    fn absolute(&self, path: Vec<String>) -> Vec<String> {
        let mut base = self.module.clone();
        match path.first().map(String::as_str) {
            Some("crate") => return [&self.module[..1], &path[1..]].concat(),
            Some("self" | "super") => {}
            _ => return path,
        }
        let mut rest = path.into_iter().peekable();
        if rest.peek().is_some_and(|part| part == "self") {
            rest.next();
        }
        while rest.peek().is_some_and(|part| part == "super") {
            rest.next();
            base.pop();
        }
        base.extend(rest);
        base
    }

    fn name(&mut self, path: Vec<String>, span: Span) {
        self.words.extend(path.iter().cloned());
        if path.len() > 1 {
            let path = self.absolute(path);
            self.names.push(Name { path, line: span.start().line });
        }
    }

    fn use_tree(&mut self, prefix: &mut Vec<String>, tree: &syn::UseTree, public: bool) {
        match tree {
            syn::UseTree::Path(path) => {
                prefix.push(path.ident.to_string());
                self.use_tree(prefix, &path.tree, public);
                prefix.pop();
            }
            syn::UseTree::Group(group) => group.items.iter().for_each(|tree| self.use_tree(prefix, tree, public)),
            syn::UseTree::Name(name) => self.import(prefix, &name.ident, &name.ident, public),
            syn::UseTree::Rename(rename) => self.import(prefix, &rename.ident, &rename.rename, public),
            syn::UseTree::Glob(glob) => {
                let path = [prefix.clone(), vec!["*".to_owned()]].concat();
                self.name(path, glob.star_token.spans[0]);
            }
        }
    }

    fn import(&mut self, prefix: &[String], name: &syn::Ident, shown: &syn::Ident, public: bool) {
        let mut path = prefix.to_vec();
        if name != "self" {
            path.push(name.to_string());
        }
        if public && self.depth == 0 {
            // `pub use inner::Thing` names a module of this one.
            let first = path.first().map(String::as_str);
            let local = !matches!(first, Some("crate" | "self" | "super"));
            let full = if local { [self.module.clone(), path.clone()].concat() } else { self.absolute(path.clone()) };
            self.exports.insert(shown.to_string(), full);
        }
        self.name(path, name.span());
    }

    /// Paths in what a macro is called with, or made of.
    fn tokens(&mut self, tokens: TokenStream) {
        let mut path: Vec<String> = Vec::new();
        let mut span = Span::call_site();
        let (mut colons, mut after_colons) = (0, false);
        for token in tokens {
            match token {
                TokenTree::Ident(ident) => {
                    if !after_colons {
                        self.name(std::mem::take(&mut path), span);
                        span = ident.span();
                    }
                    path.push(ident.to_string());
                    (colons, after_colons) = (0, false);
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' && !path.is_empty() => {
                    colons += 1;
                    after_colons = colons == 2;
                }
                TokenTree::Group(group) => {
                    self.name(std::mem::take(&mut path), span);
                    self.tokens(group.stream());
                    (colons, after_colons) = (0, false);
                }
                _ => {
                    self.name(std::mem::take(&mut path), span);
                    (colons, after_colons) = (0, false);
                }
            }
        }
        self.name(path, span);
    }
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if is_for_tests(attributes(item)) {
            let span = syn::spanned::Spanned::span(item);
            self.test_lines += span.end().line + 1 - span.start().line;
            return;
        }
        visit::visit_item(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_for_tests(&item.attrs) {
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        self.module.push(item.ident.to_string());
        self.depth += 1;
        if item.content.is_some() {
            visit::visit_item_mod(self, item);
        } else {
            let inner = self.module[self.module.len() - self.depth..].to_vec();
            self.modules.push(inner);
        }
        self.depth -= 1;
        self.module.pop();
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let public = !matches!(item.vis, syn::Visibility::Inherited);
        self.use_tree(&mut Vec::new(), &item.tree, public);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let parts = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.name(parts, syn::spanned::Spanned::span(path));
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, called: &'ast syn::Macro) {
        let name: Vec<String> = called.path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.words.insert(format!("{}!", name.join("::")));
        visit::visit_path(self, &called.path);
        self.name(name, syn::spanned::Spanned::span(&called.path));
        self.tokens(called.tokens.clone());
    }

    fn visit_ident(&mut self, ident: &'ast proc_macro2::Ident) {
        self.words.insert(ident.to_string());
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        if let syn::Expr::Path(receiver) = &*call.receiver
            && let Some(variable) = receiver.path.get_ident()
        {
            self.words.insert(format!("{variable}.{}", call.method));
        }
        visit::visit_expr_method_call(self, call);
    }
}
