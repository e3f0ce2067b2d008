//! First hits and ray counts against reference data that other programs made.

use std::path::Path;

use crate::command::{number, read_report, reference, run, stderr};

/// A little-endian f32 array of NPY format 1.0, as the reference has them.
fn read_npy(path: &Path) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!(&bytes[..8], b"\x93NUMPY\x01\x00", "{}", path.display());
    let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[header..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// Brute force in f64 says what every pixel's ray hits first: at most 2 of 62,500 may differ in hit or no hit, or
/// in depth by more than 1e-4; where both agree, so do the normals to one degree.
#[test]
fn first_hits_are_those_of_brute_force() {
    let Some(folder) = reference("first_hits_are_those_of_brute_force") else { return };
    let out = tempfile::tempdir().expect("temporary folder");
    for scene in ["gears2", "teapot12", "balls4", "tetra6"] {
        let file = folder.join(format!("scenes/{scene}.nff"));
        let image = out.path().join(format!("{scene}.png"));
        let aov = "depth,normal,primitive";
        let (file, png) = (file.to_string_lossy(), image.to_string_lossy());
        let output = run(&["render", &file, "-o", &png, "--size", "250x250", "--depth", "0", "--aov", aov]);
        assert!(output.status.success(), "{scene}: {}", stderr(&output));

        let (depth, normal) = (read_npy(&image.with_extension("t.npy")), read_npy(&image.with_extension("n.npy")));
        let expected_depth = read_npy(&folder.join(format!("hits/{scene}_250.t.npy")));
        let expected_normal = read_npy(&folder.join(format!("hits/{scene}_250.n.npy")));
        assert_eq!((depth.len(), normal.len()), (62_500, 3 * 62_500), "{scene}");
        let mut wrong = 0;
        for pixel in 0..62_500 {
            let (t, e) = (depth[pixel], expected_depth[pixel]);
            if (t < 0.0) != (e < 0.0) || (e > 0.0 && (t - e).abs() > 1e-4 * e) {
                eprintln!("{scene}: pixel {}, {} has depth {t}, expected {e}", pixel % 250, pixel / 250);
                wrong += 1;
            } else if e > 0.0 {
                let three = pixel * 3..pixel * 3 + 3;
                let cosine: f32 = three.map(|i| normal[i] * expected_normal[i]).sum();
                assert!(cosine > 1f32.to_radians().cos(), "{scene}: pixel {pixel}, normals are {cosine} apart");
            }
        }
        assert!(wrong <= 2, "{scene}: {wrong} of 62,500 pixels differ");
    }
}

/// Counts that `embree_bench.cpp` of the reference folder prints at 1000x1000, single rays, `-quality medium`, for
/// scenes made opaque; primary, shadow, reflection. They agree to 0.01%.
#[test]
fn rays_of_opaque_scenes_are_as_many_as_embrees() {
    let Some(folder) = reference("rays_of_opaque_scenes_are_as_many_as_embrees") else { return };
    let out = tempfile::tempdir().expect("temporary folder");
    let report = out.path().join("report.json");
    let embree = [
        ("teapot12", [1_000_000u64, 1_559_247, 861_954]),
        ("gears2", [1_000_000, 4_497_313, 382_485]),
        ("tetra6", [1_000_000, 176_483, 0]),
    ];
    for (scene, counts) in embree {
        let text = std::fs::read_to_string(folder.join(format!("scenes/{scene}.nff"))).expect("a reference scene");
        let opaque = out.path().join(format!("{scene}.nff"));
        std::fs::write(&opaque, without_transmittance(&text)).expect("writable folder");
        let (scene_file, report_file) = (opaque.to_string_lossy(), report.to_string_lossy());
        let png = out.path().join("image.png");
        let png = png.to_string_lossy();
        let output = run(&["render", &scene_file, "-o", &png, "--size", "1000x1000", "--report", &report_file]);
        assert!(output.status.success(), "{scene}: {}", stderr(&output));
        let said = read_report(&report);
        for (kind, expected) in ["primary", "shadow", "reflection"].into_iter().zip(counts) {
            let found = number(&said, &format!("rays.{kind}"));
            assert!(found.abs_diff(expected) * 10_000 <= expected, "{scene}: {found} {kind} rays, Embree {expected}");
        }
        assert_eq!(number(&said, "rays.refraction"), 0, "{scene}");
    }
}

/// The NFF text with the transmittance of every material set to 0.
fn without_transmittance(nff: &str) -> String {
    let opaque = |line: &str| {
        let mut words: Vec<&str> = line.split_whitespace().collect();
        if words.first() == Some(&"f") {
            words[7] = "0";
        }
        words.join(" ") + "\n"
    };
    nff.lines().map(opaque).collect()
}
