//! Smoothing groups.

use super::*;

/// A roof of two squares that meet at a right angle in the edge of vertices 2 and 3, y up.
const ROOF: &str = "v -1 0 0\nv -1 0 1\nv 0 1 1\nv 0 1 0\nv 1 0 1\nv 1 0 0\n";

#[test]
fn faces_of_a_smoothing_group_share_normals() {
    let slope = DVec3::new(-1.0, 1.0, 0.0).normalize();
    let other = DVec3::new(1.0, 1.0, 0.0).normalize();
    let scene = read(format!("{ROOF}s 1\nf 1 2 3 4\nf 3 5 6 4"), "").expect("valid");
    assert_eq!(scene.warnings, Warnings::default());
    let is_near = |normals: &[DVec3], expected: [DVec3; 4]| {
        normals.iter().zip(expected).all(|(normal, expected)| (*normal - expected).length() < 1e-15)
    };
    let [left, right] = scene.polygons[..] else { panic!("two polygons") };
    let normals = |polygon| scene.corner_normals(polygon).expect("smooth");
    assert!(is_near(normals(&left), [slope, slope, DVec3::Y, DVec3::Y]), "{:?}", scene.normals);
    assert!(is_near(normals(&right), [DVec3::Y, other, other, DVec3::Y]), "{:?}", scene.normals);

    // Other groups, and faces of none, keep their edge; a group may go on later.
    for groups in [["s 1", "s 2"], ["s 1", "s off"], ["s 1", "s 0"], ["s 4294967295", "s 3"]] {
        let obj = format!("{ROOF}{}\nf 1 2 3 4\n{}\nf 3 5 6 4", groups[0], groups[1]);
        let scene = read(obj, "").expect("valid");
        let normals = scene.corner_normals(&scene.polygons[0]).expect("smooth");
        assert!(is_near(normals, [slope; 4]), "{groups:?}");
        assert_eq!(scene.polygons[1].first_normal.is_some(), !matches!(groups[1], "s off" | "s 0"), "{groups:?}");
    }
    let scene = read(format!("{ROOF}s 1\nf 1 2 3 4\ns 2\nf 1 2 3\ns 1\nf 3 5 6 4"), "").expect("valid");
    assert!(is_near(scene.corner_normals(&scene.polygons[2]).expect("smooth"), [DVec3::Y, other, other, DVec3::Y]));
}

#[test]
fn smoothing_weighs_by_angle_and_leaves_own_normals_alone() {
    // The right square as two triangles: the middle is as before, whatever the diagonal.
    for right in ["f 3 5 6\nf 3 6 4", "f 3 5 4\nf 5 6 4"] {
        let scene = read(format!("{ROOF}s 1\nf 1 2 3 4\n{right}"), "").expect("valid");
        let normals = scene.corner_normals(&scene.polygons[0]).expect("smooth");
        assert!((normals[2] - DVec3::Y).length() < 1e-15 && (normals[3] - DVec3::Y).length() < 1e-15, "{right}");
    }
    let own = read(format!("{ROOF}vn 0 0 5\ns 1\nf 1//1 2//1 3//1 4//1\nf 3 5 6 4"), "").expect("valid");
    assert_eq!(own.corner_normals(&own.polygons[0]), Some(&[DVec3::Z; 4][..]));
    let other = DVec3::new(1.0, 1.0, 0.0).normalize();
    let normals = own.corner_normals(&own.polygons[1]).expect("smooth");
    assert!(normals.iter().all(|normal| (*normal - other).length() < 1e-15), "the other's normals do not count");
}

#[test]
fn smoothing_that_gives_no_normal_is_flat() {
    // The same triangle from both sides; and one without area.
    let text = "the normals around a corner of this face cancel out in its smoothing group: the face is flat";
    let scene = repaired("s 3\nf 1 2 3\nf 3 2 1", &[("smoothing-cancels", &format!("7:1: {text} (and 1 more)"))]);
    assert!(scene.polygons.iter().all(|polygon| polygon.first_normal.is_none()) && scene.normals.is_empty());
    let scene = repaired("s 3\nf 1 2 1\nf 1 2 3 4", &[]);
    assert!(scene.normals.iter().all(|normal| *normal == DVec3::Z), "{:?}", scene.normals);
    for (group, place) in [("on", "6:3: \"on\""), ("-1", "6:3: \"-1\""), ("", "6:3: the line ends here")] {
        let text = "expected a smoothing group, a whole number from 0 to 4294967295, or off: is read as off";
        let scene = repaired(&format!("s {group}\nf 1 2 3 4"), &[("smoothing-group", &format!("{place}, {text}"))]);
        assert_eq!(scene.polygons, [FLAT], "{group}");
    }
}
