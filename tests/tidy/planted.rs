//! Breaches that are planted: each rule must find its own.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::imports::{Imports, cycles};
use crate::source::{SourceFile, parse};
use crate::{breaches, upward};

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
    upward(&[file(path, text), other], &map)
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
    let unknown = upward(&[file("src/trace/attic.rs", "")], &BTreeMap::new());
    assert_eq!(unknown, ["src/trace/attic.rs: `attic` is not in the code map"]);
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
        ("fn fused(a: f64) -> f64 { a.mul_add(a, a) }", ".mul_add"),
        ("fn fused(a: f64) -> f64 { f64::mul_add(a, a, a) }", ".mul_add"),
    ] {
        let files = [file("src/trace/tracer/hit.rs", breach)];
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
    for breach in
        ["use super::bus;", "use super::bus::State;", "use crate::processes::bus;", "fn f() { super::bus::run() }"]
    {
        let files = [file("src/cluster/processes/node/mod.rs", breach)];
        assert_eq!(
            breaches(&files, "src/cluster/processes/node", &["cluster::processes::bus"], &[]).len(),
            1,
            "{breach}"
        );
    }
}

fn circles(files: &[SourceFile]) -> Vec<Vec<PathBuf>> {
    cycles(&Imports::of(files).arrows())
}

#[test]
fn circles_of_files_are_found_through_re_exports_and_not_between_a_module_and_its_own() {
    let root = "mod disc; mod ring; pub use disc::Disc; pub use ring::Ring;";
    let files = |disc: &str, ring: &str| {
        [
            file("src/trace.rs", "mod shapes;"),
            file("src/trace/shapes/mod.rs", root),
            file("src/trace/shapes/disc.rs", disc),
            file("src/trace/shapes/ring.rs", ring),
        ]
    };
    let both = vec![vec![PathBuf::from("src/trace/shapes/disc.rs"), PathBuf::from("src/trace/shapes/ring.rs")]];
    for (disc, ring) in [
        ("use super::ring::Ring;", "use super::disc::Disc;"),
        ("use super::Ring;", "use crate::shapes::Disc;"),
        ("fn f() -> super::ring::Ring {}", "fn f() { super::Disc::new() }"),
    ] {
        assert_eq!(circles(&files(disc, ring)), both, "{disc} {ring}");
    }
    assert!(circles(&files("use super::Ring;", "")).is_empty());
    // A module uses its children, and they what is in it.
    assert!(circles(&files("use super::SIZE;", "use super::SIZE;")).is_empty());
}
