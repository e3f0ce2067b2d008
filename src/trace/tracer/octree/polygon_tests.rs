//! Polygons as objects: every hit and every pixel is what it is with triangles, whatever the records' sizes.

use std::path::Path;

use glam::DVec3;

use crate::database::records::{LeafEntry, OctreeNode, OctreeWord, Polygon, Triangle};
use crate::database::verify::Verified;
use crate::database::{Numbers, Objects, RecordLayout, Section};
use crate::oracle;
use crate::picture::{AovSet, ImageSettings, Pixels, Rect};
use crate::preparation::{self, ViewChoices};
use crate::scene::{Scene, SceneSource};
use crate::tracer::octree::overlap::Cell;
use crate::tracer::octree::{BuildParameters, build_database, build_database_as};
use crate::tracer::slices::Slices;
use crate::tracer::{TileTracer, TraceStats, View};

const SIDE: u32 = 48;

/// Walls with holes that bridges join to the outline, a star, and a bow tie, which crosses itself.
const HOLES: &str = "\
    v 0 0 0\nv 8 0 0\nv 8 8 1\nv 0 8 1\nv 2 2 0.25\nv 2 6 0.75\nv 6 6 0.75\nv 6 2 0.25\n\
    f 1 2 3 4 1 5 6 7 8 5\n\
    v 0 0 4\nv 8 0 4\nv 8 8 4\nv 0 8 4\nv 1 1 4\nv 1 3 4\nv 3 3 4\nv 3 1 4\nv 5 5 4\nv 5 7 4\nv 7 7 4\nv 7 5 4\n\
    f 9 13 14 15 16 13 9 10 11 17 18 19 20 17 11 12\n\
    v 4 0 2\nv 5 3 2\nv 8 3 2\nv 6 5 2.5\nv 7 8 3\nv 4 6 2.5\nv 1 8 3\nv 2 5 2.5\nv 0 3 2\nv 3 3 2\n\
    f 21 22 23 24 25 26 27 28 29 30\n\
    v 1 1 6\nv 7 7 6\nv 7 1 6\nv 1 7 6\nf 31 32 33 34\n";

/// Concave, in the middle of spheres and cones, and one with vertex normals.
const CONCAVE: &str = "\
    v\nfrom 3 4 9\nat 3 3 0\nup 0 1 0\nangle 50\nhither 1\nresolution 64 64\nl 9 9 9\n\
    f 1 0.5 0.2 0.8 0.2 20 0.3 1.2\n\
    p 6\n0 0 0\n6 0 0\n6 6 0\n4 6 0\n4 2 0\n0 2 0\n\
    s 5 5 -1 0.8\n\
    p 8\n0 0 -2\n6 0 -2\n6 1 -2\n1 1 -2\n1 5 -2\n6 5 -2\n6 6 -2\n0 6 -2\n\
    c\n2 3 -1 0.5\n2 5 -1 0.2\n\
    pp 4\n1 3 1 0 0 1\n3 3 1 0 0.2 1\n3 5 1 0 0.2 1\n2 3.5 1 0.1 0 1\n";

fn scenes() -> Vec<(&'static str, Scene)> {
    let procedural = |name: &'static str| {
        let source: SceneSource = name.parse().expect(name);
        (name, source.load().expect(name))
    };
    let file = |name: &'static str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name);
        (name, crate::scene::load(&path).expect(name))
    };
    let written = |name: &str, text: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        crate::scene::load(&path).expect(name)
    };
    vec![
        procedural("teapot:2"),
        procedural("gears:1"),
        procedural("corner:2"),
        procedural("balls:1"),
        file("house.obj"),
        file("primitives.nff"),
        ("holes", written("holes.obj", HOLES)),
        ("concave", written("concave.nff", CONCAVE)),
    ]
}

fn layouts() -> [RecordLayout; 4] {
    let layout = |objects, numbers, bytes| RecordLayout::new(objects, numbers, bytes).expect("possible");
    [
        layout(Objects::Polygons, Numbers::F32, None),
        layout(Objects::Polygons, Numbers::F64, Some(300)),
        layout(Objects::Triangles, Numbers::F64, None),
        layout(Objects::Triangles, Numbers::F32, Some(496)),
    ]
}

fn view(scene: &Scene) -> View {
    let image = |_: &_| ImageSettings::new(SIDE, SIDE, 3, 0.01).map_err(|error| error.to_string());
    preparation::view(scene, &ViewChoices::default(), image).expect("a view")
}

fn traced(database: &Verified, view: &View, mailbox: bool) -> (Pixels, TraceStats) {
    let whole = Rect { x: 0, y: 0, width: SIDE, height: SIDE };
    let aov = AovSet { depth: true, normal: true, primitive: true };
    let mut tracer = TileTracer::new(&database.database().header, view, mailbox);
    let Ok(traced) = tracer.trace(&mut Slices::new(database), whole, aov);
    traced
}

#[test]
fn the_image_is_that_of_triangles_bit_by_bit() {
    for (name, scene) in scenes() {
        let view = view(&scene);
        let parameters = BuildParameters { leaf_size: 8, max_depth: 12 };
        let expected = traced(&build_database(&scene, parameters).expect("small"), &view, true);
        assert!(expected.0.primitive.iter().any(|&id| id >= 0), "{name}: something is seen");
        for layout in layouts() {
            for (leaf_size, max_depth, mailbox) in [(1, 6, true), (3, 9, false), (8, 12, true), (100, 0, true)] {
                let parameters = BuildParameters { leaf_size, max_depth };
                let database = build_database_as(&scene, parameters, layout).expect("small");
                let (pixels, stats) = traced(&database, &view, mailbox);
                assert!(pixels == expected.0, "{name}, {layout}, leaves of {leaf_size}, depth {max_depth}");
                assert_eq!(stats.rays, expected.1.rays, "{name}, {layout}");
                let has_polygons = layout.objects() == Objects::Polygons && !scene.polygons.is_empty();
                assert_eq!(stats.polygon_triangles > 0, has_polygons, "{name}, {layout}");
            }
        }
    }
}

#[test]
fn hits_are_those_of_brute_force_and_of_every_kernel() {
    for (name, scene) in scenes() {
        let view = view(&scene);
        for (layout, (leaf_size, max_depth)) in layouts().into_iter().zip([(1, 6), (2, 10), (1, 12), (8, 8)]) {
            let parameters = BuildParameters { leaf_size, max_depth };
            let database = build_database_as(&scene, parameters, layout).expect("small");
            let found = oracle::verify(&database, &view, 4000, 7);
            assert!(found.holds(), "{name}, {layout}: {:?}", found.disagreements);
        }
    }
}

#[test]
fn polygons_of_one_triangle_are_listed_where_their_triangles_are() {
    let scene: SceneSource = "teapot:6:no-board".parse().expect("a scene");
    let scene = scene.load().expect("procedural");
    let parameters = BuildParameters { leaf_size: 2, max_depth: 8 };
    let polygons = RecordLayout::new(Objects::Polygons, Numbers::F32, None).expect("possible");
    let triangles = build_database(&scene, parameters).expect("small");
    let polygons = build_database_as(&scene, parameters, polygons).expect("small");
    for section in [Section::OctreeNodes, Section::LeafLists, Section::Triangles, Section::Surfaces] {
        let words = |database: &Verified| {
            let span = database.database().header.layout.span(section);
            let bytes = database.database().header.layout.section_bytes(section);
            database.database().bytes()[span.base.0 as usize..][..bytes as usize].to_vec()
        };
        assert!(words(&triangles) == words(&polygons), "{section:?}");
    }
    let records: &[Polygon] = polygons.unpadded().records(Section::Polygons);
    assert!(records.iter().zip(0..).all(|(p, id)| (p.first_triangle, p.triangle_count) == (id, 1)));
}

/// The leaves of an octree, each with its cell and what it lists.
fn leaves(database: &Verified) -> Vec<(Cell, Vec<u32>)> {
    let words: &[OctreeWord] = database.unpadded().records(Section::OctreeNodes);
    let entries: &[LeafEntry] = database.unpadded().records(Section::LeafLists);
    let (mut rest, mut leaves) = (vec![(words[0], Cell::ROOT)], Vec::new());
    while let Some((word, cell)) = rest.pop() {
        match word.decode().expect("a known kind") {
            OctreeNode::Branch(block) => {
                rest.extend((0..8).map(|octant| (words[block as usize * 8 + octant], cell.child(octant))));
            }
            OctreeNode::Leaf(first) => {
                let list = &entries[first as usize..];
                let last = list.iter().position(|entry| entry.is_last()).expect("it ends");
                leaves.push((cell, list[..=last].iter().map(|entry| entry.primitive().0).collect()));
            }
            OctreeNode::EmptyLeaf => leaves.push((cell, Vec::new())),
        }
    }
    leaves
}

#[test]
fn a_polygon_is_listed_once_wherever_a_point_of_it_lies() {
    let polygons = RecordLayout::new(Objects::Polygons, Numbers::F32, None).expect("possible");
    for (name, scene) in scenes() {
        let database = build_database_as(&scene, BuildParameters { leaf_size: 1, max_depth: 4 }, polygons);
        let database = database.expect("small");
        let triangles: &[Triangle] = database.unpadded().records(Section::Triangles);
        let records: &[Polygon] = database.unpadded().records(Section::Polygons);
        let leaves = leaves(&database);
        for (cell, list) in &leaves {
            assert!(list.windows(2).all(|pair| pair[0] < pair[1]), "{name}: once, in order: {list:?}");
            for (id, polygon) in (0..).zip(records) {
                let points = polygon.triangles().flat_map(|triangle| {
                    let [a, b, c] = triangles[triangle as usize].vertices();
                    let at = move |i: u32, j: u32| a + (b - a) * f64::from(i) / 6.0 + (c - a) * f64::from(j) / 6.0;
                    (0..=6).flat_map(move |i| (0..=6 - i).map(move |j| at(i, j)))
                });
                let inside = |point: DVec3| (point - cell.centre).abs().max_element() <= cell.half;
                let is_inside = points.into_iter().any(inside);
                assert!(!is_inside || list.contains(&id), "{name}: polygon {id} in {cell:?}");
            }
        }
        assert!(leaves.len() > 1 || name == "holes", "{name} is divided");
    }
}
