//! Bad input is normal: every file, topology and command line here gets one clear error and exit 2.
//!
//! What each prints stands in tests/golden/bad-input.txt; `MARTI_UPDATE=1` writes it anew.

use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::command::{marti, stderr};

/// Name, the files it needs (relative path, content), the command line.
type Case = (&'static str, &'static [(&'static str, &'static [u8])], &'static [&'static str]);

/// `render bad.nff` for text that follows a good view.
macro_rules! nff {
    ($name:literal, $tail:literal) => {
        (
            $name,
            &[(
                "bad.nff",
                concat!(
                    "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 45\nhither 1\nresolution 64 64\nl 1 1 5\nf 1 1 1 1 0 1 0 1\n",
                    $tail
                )
                .as_bytes(),
            )],
            &["render", "bad.nff"],
        )
    };
}

macro_rules! obj {
    ($name:literal, $text:literal) => {
        ($name, &[("bad.obj", $text.as_bytes())], &["render", "bad.obj"])
    };
}

macro_rules! topology {
    ($name:literal, $text:literal) => {
        ($name, &[("bad.toml", $text.as_bytes())], &["check", "bad.toml"])
    };
}

const CASES: &[Case] = &[
    ("scene: no such file", &[], &["render", "absent.nff"]),
    ("scene: unknown extension", &[("scene.xyz", b"")], &["render", "scene.xyz"]),
    ("scene: a folder", &[("folder.nff/inner", b"")], &["render", "folder.nff"]),
    ("nff: empty", &[("bad.nff", b"")], &["render", "bad.nff"]),
    ("nff: binary", &[("bad.nff", b"\x7fELF\x02\x01\x01\x00\x00\xff\xfe")], &["render", "bad.nff"]),
    ("nff: not UTF-8 within", &[("bad.nff", b"# fine\nb 0 0 \xff\n")], &["render", "bad.nff"]),
    ("nff: cut short in the view", &[("bad.nff", b"v\nfrom 0 0 5\nat 0 0")], &["render", "bad.nff"]),
    (
        "nff: eye at the target",
        &[("bad.nff", b"v\nfrom 1 1 1\nat 1 1 1\nup 0 1 0\nangle 45\nhither 1\nresolution 8 8\n")],
        &["render", "bad.nff"],
    ),
    (
        "nff: angle",
        &[("bad.nff", b"v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 180\nhither 1\nresolution 8 8\n")],
        &["render", "bad.nff"],
    ),
    nff!("nff: unknown entity", "q 1 2 3\n"),
    nff!("nff: not a number", "s 0 zero 0 1\n"),
    nff!("nff: NaN", "s 0 nan 0 1\n"),
    nff!("nff: infinite", "s 0 0 inf 1\n"),
    nff!("nff: overflowing number", "s 0 0 1e999 1\n"),
    nff!("nff: out of range", "s 1e38 0 0 1\n"),
    nff!("nff: polygon of four billion vertices", "p 4294967295\n0 0 0\n"),
    nff!("nff: polygon cut short", "p 3\n0 0 0\n1 0 0\n1"),
    nff!("nff: cone cut short", "c 0 0 0 1 0 0"),
    obj!("obj: vertex with two numbers", "v 1 2\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    obj!("obj: not a number", "v 1 2 x\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    obj!("obj: NaN", "v 1 2 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    obj!("obj: face of an absent vertex", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"),
    obj!("obj: weight zero", "v 1 2 3 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    obj!("obj: coordinate without a value", "v 1 2 -1.#IND\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    obj!("obj: face of vertex zero", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"),
    ("topology: no such file", &[], &["run", "absent.toml"]),
    topology!("topology: not TOML", "[scene\n"),
    topology!("topology: no scene", "[cluster]\nnodes = 2\n"),
    topology!("topology: unknown key", "[scene]\nprocedural = \"gears\"\n[cluster]\nnods = 2\n"),
    topology!("topology: wrong type", "[scene]\nprocedural = \"gears\"\n[cluster]\nnodes = \"many\"\n"),
    topology!("topology: zero nodes", "[scene]\nprocedural = \"gears\"\n[cluster]\nnodes = 0\n"),
    topology!(
        "topology: tile larger than the image",
        "[scene]\nprocedural = \"gears\"\n[image]\nwidth = 32\nheight = 32\ntile = 64\n"
    ),
    topology!(
        "topology: more than the database",
        "[scene]\nprocedural = \"gears\"\n[cluster.local_memory]\nsize = \"9/8\"\n"
    ),
    topology!("topology: no memory", "[scene]\nprocedural = \"gears\"\n[cluster.local_memory]\nsize = 0\n"),
    topology!(
        "topology: line not a power of two",
        "[scene]\nprocedural = \"gears\"\n[cluster.local_memory]\nline = 48\n"
    ),
    topology!(
        "topology: unknown replacement",
        "[scene]\nprocedural = \"gears\"\n[cluster.local_memory]\nreplacement = \"lfu\"\n"
    ),
    topology!("topology: unknown scene", "[scene]\nprocedural = \"bunny\"\n"),
    topology!("topology: two scenes", "[scene]\nprocedural = \"gears\"\nfile = \"a.nff\"\n"),
    topology!(
        "topology: camera not a number",
        "[scene]\nfile = \"a.obj\"\n[camera]\nfrom = [0, 0, nan]\nat = [0, 0, 0]\nup = [0, 1, 0]\nangle = 45\n"
    ),
    topology!("topology: a later version", "[topology]\nversion = 2\n[scene]\nprocedural = \"gears\"\n"),
    topology!(
        "topology: a host that nobody can reach",
        "[scene]\nprocedural = \"gears\"\n[[host]]\nname = \"here\"\n[[host]]\nname = \"there\"\nlaunch = [\"ssh\", \"{host}\", \"{program}\"]\n"
    ),
    topology!(
        "topology: a launcher that starts nothing",
        "[scene]\nprocedural = \"gears\"\n[[host]]\nname = \"here\"\n[[host]]\nname = \"there\"\nlaunch = [\"ssh\", \"{host}\"]\n"
    ),
    topology!("topology: nodes on no host", "[scene]\nprocedural = \"gears\"\n[[host]]\nname = \"here\"\nnodes = 3\n"),
    ("topology: binary", &[("bad.toml", b"\x00\x01\x02\xff")], &["check", "bad.toml"]),
    (
        "override: unknown key",
        &[("good.toml", b"[scene]\nprocedural = \"gears\"\n")],
        &["check", "good.toml", "--set", "cluster.nod=3"],
    ),
    (
        "override: zero nodes",
        &[("good.toml", b"[scene]\nprocedural = \"gears\"\n")],
        &["check", "good.toml", "--set", "cluster.nodes=0"],
    ),
    (
        "override: without a value",
        &[("good.toml", b"[scene]\nprocedural = \"gears\"\n")],
        &["check", "good.toml", "--set", "cluster.nodes"],
    ),
    ("command line: nothing", &[], &[]),
    ("command line: unknown command", &[], &["rendre", "teapot"]),
    ("command line: unknown option", &[], &["render", "teapot", "--colour"]),
    ("command line: bad size", &[], &["render", "teapot", "--size", "64"]),
    ("command line: no threads", &[], &["render", "teapot", "--threads", "0"]),
    ("command line: unknown AOV", &[], &["render", "teapot", "--aov", "depth,albedo"]),
    ("command line: size of a scene", &[], &["scene", "tetra", "--size", "40"]),
    ("command line: unknown scene", &[], &["scene", "bunny"]),
    (
        "command line: vector instructions for single rays",
        &[],
        &["render", "gears", "--kernel", "single", "--simd", "sse2"],
    ),
    (
        "command line: a report in the place of the image",
        &[],
        &["render", "gears", "--output", "out/a.png", "--report", "out/a.png"],
    ),
    ("command line: a folder that is not there", &[], &["render", "gears", "--output", "none/a.png"]),
    ("command line: a report in a folder that is not there", &[], &["render", "gears", "--report", "none/a.json"]),
    ("command line: a study in a place where no folder can be", &[], &["study", "paper", "--out", "/proc/none"]),
    ("command line: neither a topology nor a scene", &[], &["run", "teapto"]),
    ("command line: a size that no scene has", &[], &["check", "gears:0"]),
    ("command line: the folder of a run", &[("out/topology.toml", b"")], &["run", "out"]),
    ("command line: a folder", &[("out/inner", b"")], &["check", "out"]),
    ("command line: nodes as an option", &[], &["run", "good.toml", "--nodes", "9"]),
    ("command line: an eye with two coordinates", &[], &["render", "gears", "--camera-from", "1,2"]),
    ("command line: a colour by its name", &[], &["render", "gears", "--background", "red"]),
    (
        "command line: an eye at the target",
        &[],
        &["render", "gears:1", "--camera-from", "1,2,3", "--camera-at", "1,2,3"],
    ),
    ("command line: a warning, and --strict", &[("bad.obj", b"v 0 0 0\n")], &["render", "bad.obj", "--strict"]),
    ("command line: unknown vector instructions", &[], &["render", "gears", "--simd", "neon"]),
    ("command line: nothing to verify", &[], &["verify"]),
    ("command line: a scene and closed meshes", &[], &["verify", "gears", "--watertight"]),
    ("command line: closed meshes elsewhere", &[], &["verify", "--watertight", "--translate", "1e6"]),
    ("command line: a scene that overflows", &[], &["verify", "gears", "--scale", "1e308"]),
];

/// What cannot change the geometry: docs/scenes.md has the table of repairs.
const REPAIRED: &[Case] = &[
    nff!("nff: sphere without radius", "s 0 0 0 0\n"),
    nff!("nff: polygon of two vertices", "p 2\n0 0 0\n1 0 0\n"),
    nff!("nff: normal of length zero", "pp 3\n0 0 0 0 0 0\n1 0 0 0 0 1\n0 1 0 0 0 1\n"),
    nff!("nff: negative diffuse", "f 1 1 1 -1 0 1 0 1\n"),
    nff!("nff: transmittance above one", "f 1 1 1 1 0 1 1.5 1\n"),
    nff!("nff: glass without an index", "f 1 1 1 1 0 1 0.5 0\n"),
    obj!("obj: face of two vertices", "v 0 0 0\nv 1 0 0\nf 1 2\n"),
    obj!("obj: absent material file", "mtllib absent.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    (
        "nff: resolution",
        &[("bad.nff", b"v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 45\nhither 1\nresolution 0 99999999\n")],
        &["render", "bad.nff"],
    ),
    obj!("obj: no such material", "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wood\nf 1 2 3\n"),
    obj!("obj: unknown statement", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvw 1 2 3\nf 1 2 3\n"),
    obj!("obj: normals that are not there", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1/1 2/2/2 3/3/3\n"),
    (
        "mtl: values out of range",
        &[
            ("bad.obj", b"mtllib BAD.MTL\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nusemtl a\r\nf 1 2 3\r\n\x1a"),
            ("bad.mtl", b"Ka 1 1 1\nnewmtl a\nKd 1 0 0 1\nNi 0\nd 1.5\nillum 2.0\nNs -1\nmap_Kd a.png\n"),
        ],
        &["render", "bad.obj"],
    ),
];

#[test]
fn what_cannot_change_the_geometry_is_repaired_and_rendered() {
    for (name, files, arguments) in REPAIRED {
        let folder = tempfile::tempdir().expect("temporary folder");
        for (path, content) in *files {
            std::fs::write(folder.path().join(path), content).expect("writable folder");
        }
        let mut command = marti();
        command.current_dir(folder.path()).args(*arguments).args(["--size", "8x8", "-o", "out.png"]);
        let output = command.output().expect("marti can be started");
        assert_eq!(output.status.code(), Some(0), "{name}: {}", stderr(&output));
        assert!(folder.path().join("out.png").is_file(), "{name} has no image");
    }
}

#[test]
fn every_bad_input_gets_a_clear_error_and_exit_2() {
    assert!(CASES.len() >= 40);
    let mut printed = String::new();
    for (name, files, arguments) in CASES {
        let folder = tempfile::tempdir().expect("temporary folder");
        for (path, content) in *files {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("writable folder");
            std::fs::write(path, content).expect("writable folder");
        }
        let started = Instant::now();
        let output = marti().current_dir(folder.path()).args(*arguments).output().expect("marti can be started");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{name}: {:?}\n{said}", output.status);
        assert!(!said.contains("panicked"), "{name}:\n{said}");
        assert!(started.elapsed() < Duration::from_secs(10), "{name} took {:?}", started.elapsed());
        let left = std::fs::read_dir(folder.path()).expect("readable folder").count();
        assert!(left <= files.len(), "{name} left files behind");
        let command = format!("marti {}", arguments.join(" "));
        writeln!(printed, "{name}\n    $ {}\n    {}\n", command.trim_end(), said.trim_end().replace('\n', "\n    "))
            .expect("a string can be written to");
    }
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/bad-input.txt");
    if std::env::var_os("MARTI_UPDATE").is_some() {
        std::fs::write(&golden, &printed).expect("the golden file can be written");
    }
    let expected = std::fs::read_to_string(&golden).unwrap_or_default();
    assert!(
        printed == expected,
        "what is printed is not what {} has; MARTI_UPDATE=1 writes it anew:\n{printed}",
        golden.display()
    );
}

/// A file that claims much and holds little costs neither time nor memory: here 64 MB of one token.
#[test]
fn a_huge_token_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let file = folder.path().join("huge.nff");
    std::fs::write(&file, vec![b'9'; 64 << 20]).expect("writable folder");
    let output = marti().arg("render").arg(&file).output().expect("marti can be started");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).len() < 1000, "{}", &stderr(&output)[..1000]);
}
