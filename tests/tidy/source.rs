//! What a source file of the program names: read by a parser, test modules left out wherever they are.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, Span, TokenStream, TokenTree};
use syn::ext::IdentExt;
use syn::visit::{self, Visit};

use crate::LAYERS;

/// A name in the code: the path of a module or of an item in it, and where it is written.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Name {
    /// Absolute. The first part is the name of its own layer, of another crate, or of a local item.
    pub(crate) path: Vec<String>,
    pub(crate) line: usize,
    /// What it names is an import of something in the layers, which has a [`Name`] of its own.
    pub(crate) leads_on: bool,
}

/// A path as it is written, not yet followed through imports.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Written {
    /// The module around it.
    pub(crate) scope: Vec<String>,
    pub(crate) path: Vec<String>,
    /// It begins with `crate`, `self`, `super` or `::`, and is absolute now.
    pub(crate) is_rooted: bool,
    pub(crate) line: usize,
}

/// What a `use` makes visible in its module.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Import {
    /// `*` for a glob.
    pub(crate) shown: String,
    /// Without the `*`.
    pub(crate) of: Written,
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
    pub(crate) written: BTreeSet<Written>,
    pub(crate) imports: BTreeSet<Import>,
    /// Paths of what is defined here.
    pub(crate) items: BTreeSet<Vec<String>>,
    /// All that is `written`, and where it leads: filled by [`crate::paths::resolve`].
    pub(crate) names: Vec<Name>,
    /// Spellings that hide what is named, each with its line.
    pub(crate) hidden: Vec<(usize, String)>,
    /// Every single name in the code, macros with `!`, and methods of variables, as in `scope.spawn`.
    pub(crate) words: BTreeSet<String>,
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
        written: BTreeSet::new(),
        imports: BTreeSet::new(),
        items: BTreeSet::new(),
        hidden: Vec::new(),
        words: BTreeSet::new(),
        modules: Vec::new(),
        test_lines: 0,
        depth: 0,
    };
    reader.visit_file(&file);
    let lines = text.lines().count() - reader.test_lines.min(text.lines().count());
    let Reader { written, imports, items, hidden, words, modules, .. } = reader;
    (SourceFile { path, module, written, imports, items, names: Vec::new(), hidden, words, lines }, modules)
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
    written: BTreeSet<Written>,
    imports: BTreeSet<Import>,
    items: BTreeSet<Vec<String>>,
    hidden: Vec<(usize, String)>,
    words: BTreeSet<String>,
    /// Declared here and in files of their own: their paths from this file's module on.
    modules: Vec<Vec<String>>,
    test_lines: usize,
    /// Inline modules around what is visited.
    depth: usize,
}

/// An identifier without `r#`, which changes nothing of what it names.
fn plain(ident: &syn::Ident) -> String {
    ident.unraw().to_string()
}

/// Whether an item is compiled for tests alone: `cfg(test)`, or `cfg(all(…))` of which one condition is just `test`.
fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    let names_test = |attribute: &syn::Attribute| {
        let syn::Meta::List(list) = &attribute.meta else { return false };
        let tokens: Vec<TokenTree> = list.tokens.clone().into_iter().collect();
        let is_test = |tokens: &[TokenTree]| matches!(tokens, [TokenTree::Ident(ident)] if ident == "test");
        list.path.is_ident("cfg")
            && match &tokens[..] {
                [TokenTree::Ident(all), TokenTree::Group(conditions)] if all == "all" => {
                    let conditions: Vec<TokenTree> = conditions.stream().into_iter().collect();
                    let is_comma =
                        |token: &TokenTree| matches!(token, TokenTree::Punct(punct) if punct.as_char() == ',');
                    conditions.split(is_comma).any(is_test)
                }
                tokens => is_test(tokens),
            }
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

/// What an item is called.
fn ident(item: &syn::Item) -> Option<&syn::Ident> {
    Some(match item {
        syn::Item::Const(item) => &item.ident,
        syn::Item::Enum(item) => &item.ident,
        syn::Item::Fn(item) => &item.sig.ident,
        syn::Item::Macro(item) => item.ident.as_ref()?,
        syn::Item::Mod(item) => &item.ident,
        syn::Item::Static(item) => &item.ident,
        syn::Item::Struct(item) => &item.ident,
        syn::Item::Trait(item) => &item.ident,
        syn::Item::Type(item) => &item.ident,
        syn::Item::Union(item) => &item.ident,
        _ => return None,
    })
}

/// Whether a path as written is the root of a crate, or may be: the name of one, or one that ends in a keyword.
fn is_root(path: &[String]) -> bool {
    let crates = |name: &str| LAYERS.contains(&name) || ["std", "core", "alloc"].contains(&name);
    match path {
        [name] => crates(name) || name == "crate" || name == "super",
        [.., last] => last == "crate" || last == "super" || last == "self",
        [] => false,
    }
}

impl Reader {
    /// Follows `crate`, `self` and `super`; whether there was one.
    fn absolute(&self, mut path: Vec<String>) -> (Vec<String>, bool) {
        let mut base = self.module.clone();
        match path.first().map(String::as_str) {
            Some("crate") => return ([&self.module[..1], &path[1..]].concat(), true),
            Some("self" | "super") => {}
            // The standard library's other names.
            Some("core" | "alloc") => {
                path[0] = "std".to_owned();
                return (path, false);
            }
            _ => return (path, false),
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
        (base, true)
    }

    fn written(&self, path: Vec<String>, line: usize) -> Written {
        let (path, is_rooted) = self.absolute(path);
        Written { scope: self.module.clone(), path, is_rooted, line }
    }

    fn name(&mut self, path: Vec<String>, span: Span) {
        self.words.extend(path.iter().cloned());
        if !path.is_empty() {
            let written = self.written(path, span.start().line);
            self.written.insert(written);
        }
    }

    fn hide(&mut self, span: Span, what: impl Into<String>) {
        self.hidden.push((span.start().line, what.into()));
    }

    fn use_tree(&mut self, prefix: &mut Vec<String>, tree: &syn::UseTree, is_rooted: bool) {
        match tree {
            syn::UseTree::Path(path) => {
                prefix.push(plain(&path.ident));
                self.use_tree(prefix, &path.tree, is_rooted);
                prefix.pop();
            }
            syn::UseTree::Group(group) => group.items.iter().for_each(|tree| self.use_tree(prefix, tree, is_rooted)),
            syn::UseTree::Name(name) => self.import(prefix, &name.ident, &name.ident, is_rooted),
            syn::UseTree::Rename(rename) => {
                let path = [&prefix[..], &[plain(&rename.ident)]].concat();
                if is_root(&path) {
                    self.hide(rename.ident.span(), format!("`{} as {}`", path.join("::"), rename.rename));
                }
                self.import(prefix, &rename.ident, &rename.rename, is_rooted);
            }
            syn::UseTree::Glob(glob) => {
                let of = self.written(prefix.clone(), glob.star_token.spans[0].start().line);
                if of.path.len() < 2 {
                    self.hide(glob.star_token.spans[0], format!("`{}::*`", prefix.join("::")));
                }
                self.imports.insert(Import { shown: "*".to_owned(), of });
                let path = [prefix.clone(), vec!["*".to_owned()]].concat();
                self.name(path, glob.star_token.spans[0]);
            }
        }
    }

    fn import(&mut self, prefix: &[String], name: &syn::Ident, shown: &syn::Ident, is_rooted: bool) {
        let mut path = prefix.to_vec();
        if name != "self" {
            path.push(plain(name));
        }
        let shown = if shown == "self" { path.last().cloned().unwrap_or_default() } else { plain(shown) };
        let mut of = self.written(path.clone(), name.span().start().line);
        // `use rustls;` would lead to itself.
        of.is_rooted |= is_rooted || of.path.len() == 1;
        self.imports.insert(Import { shown, of });
        self.name(path, name.span());
    }

    /// A path in a macro ends: one that is a root may be continued where nobody sees it.
    fn macro_name(&mut self, path: Vec<String>, span: Span) {
        if is_root(&path) && !matches!(&path[..], [only] if LAYERS.contains(&only.as_str()) || only == "core") {
            self.hide(span, format!("`{}` in a macro, without what follows it", path.join("::")));
        }
        self.name(path, span);
    }

    /// A path in a macro goes on with a variable of the macro: no module may be behind that.
    fn spliced(&mut self, path: &[String], span: Span) {
        let (absolute, is_rooted) = self.absolute(path.to_vec());
        let is_layer = LAYERS.contains(&absolute[0].as_str());
        let is_module = path.last().is_some_and(|last| last.starts_with(char::is_lowercase));
        let is_hidden = if is_rooted || is_layer { absolute.len() < 3 } else { is_module };
        if is_hidden {
            self.hide(span, format!("`{}::$…`", path.join("::")));
        }
    }

    /// Paths in what a macro is called with, or made of; `prefix` is before the braces around it.
    fn tokens(&mut self, tokens: TokenStream, prefix: &[String]) {
        let mut path: Vec<String> = Vec::new();
        let mut span = Span::call_site();
        let (mut colons, mut after_colons) = (0, false);
        let (mut before, mut is_alias) = (String::new(), false);
        for token in tokens {
            let text = if let TokenTree::Group(_) = token { String::new() } else { token.to_string() };
            match token {
                TokenTree::Ident(ident) if before == "$" && ident != "crate" => {
                    if after_colons {
                        self.spliced(&path, span);
                    }
                    self.macro_name(std::mem::take(&mut path), span);
                    (colons, after_colons) = (0, false);
                    self.words.insert(plain(&ident));
                }
                TokenTree::Ident(ident) if !prefix.is_empty() && (ident == "as" || is_alias) => {
                    self.macro_name(std::mem::take(&mut path), span);
                    is_alias = ident == "as";
                }
                TokenTree::Ident(ident) => {
                    if !after_colons {
                        self.macro_name(std::mem::take(&mut path), span);
                        span = ident.span();
                        path.extend_from_slice(prefix);
                    }
                    path.push(plain(&ident));
                    (colons, after_colons) = (0, false);
                }
                TokenTree::Punct(punct) if punct.as_char() == ':' && !path.is_empty() => {
                    colons += 1;
                    after_colons = colons == 2;
                }
                TokenTree::Punct(punct) if punct.as_char() == '$' => {
                    if !after_colons {
                        self.macro_name(std::mem::take(&mut path), span);
                    }
                }
                TokenTree::Punct(punct) if punct.as_char() == '*' && after_colons => {
                    if self.absolute(path.clone()).0.len() < 2 {
                        self.hide(span, format!("`{}::*`", path.join("::")));
                    }
                    path.push("*".to_owned());
                    self.name(std::mem::take(&mut path), span);
                    (colons, after_colons) = (0, false);
                }
                TokenTree::Group(group) if after_colons && group.delimiter() == Delimiter::Brace => {
                    let inner = std::mem::take(&mut path);
                    self.tokens(group.stream(), &inner);
                    (colons, after_colons) = (0, false);
                }
                TokenTree::Group(group) => {
                    let is_visibility = before == "pub" && group.delimiter() == Delimiter::Parenthesis;
                    self.macro_name(std::mem::take(&mut path), span);
                    if before == "#" && group.stream().to_string().starts_with("path ") {
                        self.hide(group.span(), "`#[path]`");
                    }
                    if !is_visibility {
                        self.tokens(group.stream(), prefix);
                    }
                    (colons, after_colons) = (0, false);
                }
                _ => {
                    if text == "!" && before == "include" {
                        self.hide(span, "`include!`");
                    }
                    self.macro_name(std::mem::take(&mut path), span);
                    (colons, after_colons) = (0, false);
                }
            }
            before = text;
        }
        self.macro_name(path, span);
    }
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if is_for_tests(attributes(item)) {
            let span = syn::spanned::Spanned::span(item);
            self.test_lines += span.end().line + 1 - span.start().line;
            return;
        }
        if let Some(ident) = ident(item) {
            self.items.insert([&self.module[..], &[plain(ident)]].concat());
        }
        if let syn::Item::ExternCrate(item) = item {
            self.hide(item.ident.span(), format!("`extern crate {}`", item.ident));
        }
        for attribute in attributes(item) {
            let is_path = attribute.path().is_ident("path");
            let is_conditional = attribute.path().is_ident("cfg_attr")
                && matches!(&attribute.meta, syn::Meta::List(list) if list.tokens.to_string().contains("path ="));
            if is_path || is_conditional {
                self.hide(syn::spanned::Spanned::span(attribute), "`#[path]`");
            }
        }
        visit::visit_item(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_for_tests(&item.attrs) {
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        self.module.push(plain(&item.ident));
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
        self.use_tree(&mut Vec::new(), &item.tree, item.leading_colon.is_some());
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let parts = path.segments.iter().map(|segment| plain(&segment.ident)).collect();
        self.name(parts, syn::spanned::Spanned::span(path));
        visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, called: &'ast syn::Macro) {
        let name: Vec<String> = called.path.segments.iter().map(|segment| plain(&segment.ident)).collect();
        if name.last().is_some_and(|last| last == "include") {
            self.hide(syn::spanned::Spanned::span(&called.path), "`include!`");
        }
        self.words.insert(format!("{}!", name.join("::")));
        visit::visit_path(self, &called.path);
        self.name(name, syn::spanned::Spanned::span(&called.path));
        self.tokens(called.tokens.clone(), &[]);
    }

    fn visit_ident(&mut self, ident: &'ast proc_macro2::Ident) {
        self.words.insert(plain(ident));
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        if let syn::Expr::Path(receiver) = &*call.receiver
            && let Some(variable) = receiver.path.get_ident()
        {
            self.words.insert(format!("{}.{}", plain(variable), plain(&call.method)));
        }
        visit::visit_expr_method_call(self, call);
    }
}
