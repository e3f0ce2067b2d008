//! Breaches that are planted: each rule must find its own.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::breaches;
use crate::code_map::{code_map, downward, missing, unused, upward};
use crate::imports::{Imports, cycles};
use crate::paths::resolve;
use crate::roots::{beyond_modules, beyond_re_exports};
use crate::source::{SourceFile, parse};

/// A file of a library, as `src/machine/hardware/bus.rs` is.
fn file(path: &str, text: &str) -> SourceFile {
    let module = path.trim_start_matches("src/").trim_end_matches(".rs").trim_end_matches("/mod");
    let module = module.split('/').map(str::to_owned).collect();
    parse(text, PathBuf::from(path), module).0
}

/// Two modules of which `scene` may know nothing, and `tracer` the scene.
fn found(path: &str, text: &str) -> Vec<String> {
    let map = BTreeMap::from([("scene".to_owned(), vec![]), ("tracer".to_owned(), vec!["scene".to_owned()])]);
    let other = if path.starts_with("src/trace/scene") {
        file("src/trace/tracer/mod.rs", "")
    } else {
        file("src/trace/scene/mod.rs", "")
    };
    upward(&resolve(vec![file(path, text), other]), &map)
}

#[test]
fn an_upward_import_is_found_however_it_is_written() {
    for breach in [
        "use crate::tracer::Ray;",
        "use crate::{ids, tracer::{hit, Ray as Beam}};",
        "pub use crate::tracer;",
        "use trace::tracer::Ray;",
        "use super::super::tracer::Ray;",
        "mod inner { use super::super::super::tracer::Ray; }",
        "fn shoot() -> crate::tracer::Ray { todo!() }",
        "fn shoot() { let _ = crate::tracer::Ray::new(); }",
        "fn shoot() { println!(\"{}\", crate::tracer::COUNT); }",
        "macro_rules! shoot { () => { $crate::tracer::Ray::new() } }",
        "impl From<crate::tracer::Ray> for u8 { fn from(_: crate::tracer::Ray) -> u8 { 0 } }",
        "#[cfg(test)]\nmod tests { fn fine() {} }\nuse crate::tracer::Ray;",
        "#[cfg(not(test))]\nuse crate::tracer::Ray;",
        "#[cfg(all(unix, not(test)))]\nuse crate::tracer::Ray;",
        "#[cfg(all(unix, feature = \"testing\"))]\nuse crate::tracer::Ray;",
        "#[cfg(any(test, unix))]\nuse crate::tracer::Ray;",
        "fn shoot() { crate::r#tracer::Ray::new() }",
        "use crate::r#tracer::Ray;",
        "use ::trace::tracer::Ray;",
        "macro_rules! shoot { () => { use crate::{ids, tracer::{View as _, Ray}}; } }",
        "shoot! { use crate::tracer::*; }",
        "use crate::tracer::*;",
    ] {
        let found = found("src/trace/scene/nff.rs", breach);
        let line = breach.lines().count();
        assert!(
            found.iter().any(|what| what.starts_with(&format!("src/trace/scene/nff.rs:{line} names `trace::tracer"))),
            "{breach}: {found:?}"
        );
    }
}

#[test]
fn what_is_allowed_or_a_test_s_is_not_reported() {
    assert_eq!(
        found("src/trace/tracer/hit.rs", "use crate::scene::Scene; use super::ray; use std::fmt;"),
        Vec::<String>::new()
    );
    for fine in [
        "#[cfg(test)]\nmod tests { use crate::tracer::Ray; }",
        "#[cfg(test)]\nuse crate::tracer::Ray;",
        "#[cfg(test)]\nfn one() -> crate::tracer::Ray { todo!() }",
        "struct S; impl S { #[cfg(test)] fn one() -> crate::tracer::Ray { todo!() } }",
        "// use crate::tracer::Ray;\nconst TEXT: &str = \"crate::tracer::Ray\";",
    ] {
        assert_eq!(found("src/trace/scene/nff.rs", fine), Vec::<String>::new(), "{fine}");
    }
    for fine in [
        "#[cfg(all(unix, test))]\nuse crate::tracer::Ray;",
        "#[cfg(test)]\n#[path = \"nff_tests.rs\"]\nmod tests;",
        "use super::source::Source as Text; use std::io::{self, Read as _}; use proptest::prelude::*;",
        "macro_rules! fine { ($name:ident) => { pub(crate) fn $name() { Section::$name; $name::new(self.x) } } }",
        "fn f() { assert_eq!(self, [self], \"{}\", include_str!(\"teapot\")); }",
    ] {
        assert_eq!(found("src/trace/scene/nff.rs", fine), Vec::<String>::new(), "{fine}");
        assert_eq!(file("src/trace/scene/nff.rs", fine).hidden, [], "{fine}");
    }
    let unknown = upward(&resolve(vec![file("src/trace/attic.rs", "")]), &BTreeMap::new());
    assert_eq!(unknown, ["src/trace/attic.rs: `attic` is not in the code map"]);
}

#[test]
fn a_spelling_that_hides_what_is_named_is_refused() {
    for hidden in [
        "use super::super as up; fn f() { up::tracer::Ray::new() }",
        "use super as up;",
        "use crate as root;",
        "use crate::{self as root};",
        "use crate::nff::{self as _, super as up};",
        "use self::super as up;",
        "use trace as t;",
        "use ::trace as t;",
        "use std as s; fn f() { s::fs::read(\"\") }",
        "use core as c;",
        "extern crate self as me;",
        "extern crate std as s;",
        "extern crate rustls;",
        "use crate::*; fn f() { tracer::Ray::new() }",
        "use super::super::*;",
        "use trace::*;",
        "use std::*; fn f() { fs::read(\"\") }",
        "include!(\"other.rs\");",
        "fn f() { std::include!(\"other.rs\") }",
        "fn f() { say!(include!(\"other.rs\")) }",
        "#[path = \"other.rs\"]\nmod other;",
        "#[cfg_attr(unix, path = \"other.rs\")]\nmod other;",
        "say! { #[path = \"other.rs\"] mod other; }",
        "macro_rules! shoot { ($a:ident) => { crate::$a::Ray::new() } }",
        "macro_rules! shoot { ($a:ident) => { super::super::$a::Ray::new() } }",
        "macro_rules! shoot { ($a:ident) => { $crate::$a::Ray::new() } }",
        "macro_rules! shoot { ($a:ident) => { std::$a::read() } }",
        "macro_rules! shoot { ($a:ident) => { tracer::$a::Ray::new() } }",
        "macro_rules! shoot { ($a:ident) => { trace::tracer::$a() } }",
        "shoot!(crate);",
        "shoot!(super::super);",
        "shoot! { use crate as me; }",
        "shoot! { use crate::{self as me}; }",
        "shoot! { use crate::*; }",
        "shoot! { use std::*; }",
        "shoot! { extern crate std as s; }",
    ] {
        assert_ne!(file("src/trace/scene/nff.rs", hidden).hidden, [], "{hidden}");
    }
}

#[test]
fn a_re_export_is_followed_from_module_to_module() {
    let map = BTreeMap::from([("scene", vec!["picture"]), ("picture", vec!["tracer"]), ("tracer", vec![])]);
    let owned = |known: Vec<&str>| known.into_iter().map(str::to_owned).collect();
    let map = map.into_iter().map(|(module, known)| (module.to_owned(), owned(known))).collect();
    let exports = |picture: &str, scene: &str| {
        let files = vec![
            file("src/trace/tracer.rs", "pub mod ray;"),
            file("src/trace/tracer/ray.rs", "pub struct Ray;"),
            file("src/trace/picture.rs", picture),
            file("src/trace/scene.rs", scene),
        ];
        upward(&resolve(files), &map)
    };
    for (picture, scene) in [
        ("pub use crate::tracer as rays;", "use crate::picture::rays::ray::Ray;"),
        ("pub use crate::tracer::ray::Ray as Beam;", "fn f() -> crate::picture::Beam {}"),
        ("pub use crate::tracer::ray::*;", "use crate::picture::Ray;"),
        ("pub use crate::tracer::*;", "use crate::picture::ray;"),
        ("pub mod inner { pub use crate::tracer::ray; }", "use crate::picture::inner::ray::Ray;"),
        ("pub use crate::tracer as rays;", "use crate::picture as p; fn f() -> p::rays::ray::Ray {}"),
        ("pub use crate::tracer as rays;", "use crate::picture::*; fn f() -> rays::ray::Ray {}"),
        ("pub use crate::tracer::ray::Ray;", "use crate::picture::*; fn f() -> Ray {}"),
        ("use crate::tracer; pub use tracer::ray::Ray;", "use crate::picture::Ray;"),
    ] {
        let found = exports(picture, scene);
        let is_led = |line: &String| line.starts_with("src/trace/scene.rs:1 names `trace::tracer");
        assert!(found.iter().any(is_led), "{picture} {scene}: {found:?}");
    }
    assert_eq!(exports("pub use crate::tracer::ray::Ray; pub struct Disc;", "use crate::picture::Disc;"), [""; 0]);
    // A function and a module of one name.
    assert_eq!(exports("mod load { pub fn load() {} } pub use load::load;", "use crate::picture::load;"), [""; 0]);
}

#[test]
fn what_a_root_file_must_not_have_is_found() {
    for breach in ["pub mod a { }", "pub use ground::ids;", "fn f() {}", "pub mod a; use std::fmt;", "struct S;"] {
        assert_eq!(beyond_modules(breach).len(), 1, "{breach}");
    }
    assert_eq!(beyond_modules("#[cfg(unix)]\npub mod a; mod b;"), [""; 0]);
    for breach in [
        "fn f() {}",
        "use trace::scene::Scene;",
        "pub use cluster;",
        "pub use cluster as c;",
        "pub use cluster::topology;",
        "pub use cluster::{topology::{self}};",
        "pub use cluster::*;",
        "pub use ::cluster::*;",
        "pub use crate::picture;",
        "pub use std::fs;",
        "pub mod a { fn f() {} }",
        "pub mod a { pub mod b { pub struct S; } }",
        "pub mod a;",
        "mod a {}",
        "println!();",
    ] {
        assert_eq!(beyond_re_exports(breach).len(), 1, "{breach}");
    }
    let fine = "#[cfg(unix)]\ncompile_error!(\"no\"); pub use glam; pub use trace::picture::*; \
                pub mod a { pub use trace::scene::{Scene, load::{self, load}}; pub mod b {} }";
    assert_eq!(beyond_re_exports(fine), [""; 0]);
}

#[test]
fn a_permission_that_is_idle_or_upside_down_is_found() {
    let row = |module: &str, known: &str| format!("| `{module}` | what it is | {known} |\n");
    let map = row("scene", "–") + &row("tracer", "`scene`");
    let files = |tracer: &str| resolve(vec![file("src/trace/scene.rs", ""), file("src/trace/tracer.rs", tracer)]);
    assert_eq!(unused(&files("use crate::scene::Scene;"), &code_map(&map)), [""; 0]);
    assert_eq!(
        unused(&files("#[cfg(test)]\nuse crate::scene::Scene;"), &code_map(&map)),
        ["`tracer` may know `scene`, and does not"]
    );
    assert_eq!(downward(&map), [""; 0]);
    let found = downward(&(row("scene", "`tracer`") + &row("tracer", "–")));
    assert_eq!(found, ["`scene` may know `tracer`, which is not above it"]);
}

#[test]
fn what_a_page_names_and_is_not_there_is_found() {
    let files = [file("src/trace/tracer/octree/build.rs", "pub fn build() {} pub struct Tree;")];
    let paths: Vec<PathBuf> =
        ["src/trace/tracer/octree", "src/trace/tracer/octree/build.rs"].into_iter().map(PathBuf::from).collect();
    for name in [
        "src/trace/tracer/octree/build.rs",
        "octree/build.rs",
        "octree/build",
        "tracer/octree/",
        "octree::build",
        "octree::build::build",
        "octree::build::Tree::new",
        "octree::{build}",
    ] {
        assert_eq!(missing(&format!("see `{name}`."), &paths, &files), [""; 0], "{name}");
    }
    for name in
        ["octree/builds.rs", "database/recordz.rs", "builds.rs", "tracer::octree::villain", "octree::build::Trees"]
    {
        assert_eq!(missing(&format!("see `{name}`."), &paths, &files), [name], "{name}");
    }
    assert_eq!(missing("`octree/{build, burn}.rs`", &paths, &files), ["octree/burn.rs"]);
}

#[test]
fn what_a_pure_module_must_not_name_is_found() {
    for (breach, word) in [
        ("use std::{fmt, net::TcpStream};", "std::net"),
        ("fn now() { let _ = std::time::Instant::now(); }", "std::time"),
        ("use tokio::time::Instant;", "Instant"),
        ("async fn wait() { tokio::task::yield_now().await }", "tokio"),
        ("fn say() { if true { vec![()].iter().for_each(|_| println!()); } }", "println!"),
        ("fn go(scope: &Scope) { scope.spawn(|| ()); }", "scope.spawn"),
        ("use std::println as p; fn say() { p!() }", "println!"),
        ("use core::time::Duration;", "std::time"),
        ("use std::time as t; fn now() -> t::Instant { todo!() }", "std::time"),
        ("use std::{fs as f}; fn go() { f::read(\"\") }", "std::fs"),
        ("fn go() { std::r#fs::read(\"\") }", "std::fs"),
        ("fn wait() { std::thread::sleep(PERIOD) }", "std::thread"),
        ("fn ask() { std::env::var(\"A\") }", "std::env"),
        ("use std::hash::RandomState;", "RandomState"),
        ("use std::collections::{BTreeMap, HashMap};", "HashMap"),
        ("use std::collections::*; fn f() -> HashMap<u8, u8> {}", "HashMap"),
        ("fn fused(a: f64) -> f64 { a.mul_add(a, a) }", ".mul_add"),
        ("fn fused(a: f64) -> f64 { f64::mul_add(a, a, a) }", ".mul_add"),
    ] {
        let files = resolve(vec![file("src/trace/tracer/hit.rs", breach)]);
        assert_eq!(breaches(&files, "src/trace/tracer", &[word], &[]).len(), 1, "{breach}");
        assert!(
            breaches(&files, "src/trace/tracer", &[word], &["src/trace/tracer/hit.rs"]).is_empty(),
            "{breach}: excepted"
        );
        assert!(breaches(&files, "src/trace/scene", &[word], &[]).is_empty(), "{breach}: elsewhere");
    }
}

#[test]
fn a_process_that_imports_another_is_found() {
    for breach in [
        "use super::bus;",
        "use super::bus::State;",
        "use crate::processes::bus;",
        "fn f() { super::bus::run() }",
        "use super as all; fn f() { all::bus::run() }",
        "use crate::processes; fn f() { processes::bus::run() }",
        "use crate::processes as p; fn f() { p::bus::run() }",
        "use crate::{processes::{self as p}}; fn f() { p::bus::run() }",
        "use super::*; fn f() { bus::run() }",
        "fn f() { use crate::processes as p; p::bus::run() }",
        "mod inner { use super::super as p; fn f() { p::bus::run() } }",
        "macro_rules! f { () => { $crate::processes::{node, bus::run} } }",
    ] {
        let files = resolve(vec![
            file("src/cluster/processes/mod.rs", "mod bus; mod node;"),
            file("src/cluster/processes/bus.rs", "pub fn run() {}"),
            file("src/cluster/processes/node/mod.rs", breach),
        ]);
        let found = breaches(&files, "src/cluster/processes/node", &["cluster::processes::bus"], &[]);
        assert_eq!(found.len(), 1, "{breach}");
    }
}

fn circles(files: &[SourceFile]) -> Vec<Vec<PathBuf>> {
    cycles(&Imports::of(&resolve(files.to_vec())).arrows())
}

#[test]
fn circles_of_files_are_found_through_re_exports_and_not_between_a_module_and_its_own() {
    let root = "mod disc; mod ring; pub use disc::Disc; pub use ring::Ring;";
    let files = |disc: &str, ring: &str| {
        [
            file("src/trace.rs", "mod shapes;"),
            file("src/trace/shapes/mod.rs", root),
            file("src/trace/shapes/disc.rs", &format!("{disc} pub struct Disc;")),
            file("src/trace/shapes/ring.rs", &format!("{ring} pub struct Ring;")),
        ]
    };
    let both = vec![vec![PathBuf::from("src/trace/shapes/disc.rs"), PathBuf::from("src/trace/shapes/ring.rs")]];
    for (disc, ring) in [
        ("use super::ring::Ring;", "use super::disc::Disc;"),
        ("use super::Ring;", "use crate::shapes::Disc;"),
        ("fn f() -> super::ring::Ring {}", "fn f() { super::Disc::new() }"),
        ("use super::*; fn f() -> Ring {}", "use super::*; fn f() { Disc::new() }"),
        ("use super::*; fn f() -> ring::Ring {}", "use super::super::shapes as all; fn f() -> all::disc::Disc {}"),
        ("use super::ring::*;", "use crate::shapes; fn f() -> shapes::Disc {}"),
    ] {
        assert_eq!(circles(&files(disc, ring)), both, "{disc} {ring}");
    }
    assert!(circles(&files("use super::Ring;", "")).is_empty());
    // A module uses its children, and they what is in it.
    assert!(circles(&files("use super::SIZE;", "use super::SIZE;")).is_empty());
}
