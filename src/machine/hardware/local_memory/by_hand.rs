//! A quadrilateral as an object, counted by hand.

use super::*;
use crate::hardware::cluster_memory::ClusterMemory;
use crate::hardware::references::{RecordNumbers, Recorder};
use crate::hardware::replacement::Lru;
use crate::hardware::specification::{self, MemorySize};
use crate::replay::RecordLines;
use crate::replay::model::replayer::{Replayer, Sum};
use crate::replay::stream::captured::Captured;
use ground::ids::{Address, NodeId, TileId};
use trace::database::verify::Verified;
use trace::database::{Numbers, Objects, RecordLayout};
use trace::scene::{Material, Polygon, Scene};
use trace::tracer::TraceStats;
use trace::tracer::octree::hero::Hero;
use trace::tracer::octree::{BuildParameters, build_database_as};
use trace::tracer::ray::{Ray, Source};

/// A square in the plane z = 0 as a polygon of 300 bytes, numbers of 64 bits; the octree is one leaf.
fn quad() -> Verified {
    let scene = Scene {
        materials: vec![Material::WHITE],
        vertices: [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| [x, y, 0.0].into()).into(),
        polygons: vec![Polygon {
            first_vertex: 0,
            vertex_count: 4,
            first_normal: None,
            first_colour: None,
            material: 0,
        }],
        ..Scene::default()
    };
    let layout = RecordLayout::new(Objects::Polygons, Numbers::F64, Some(300)).expect("possible");
    build_database_as(&scene, BuildParameters { leaf_size: 1, max_depth: 6 }, layout).expect("small")
}

/// What a ray that hits the square reads, on lines of 16 bytes:
///
/// | record | bytes | lines | of them new |
/// |---|---|---|---|
/// | octree node 0 | 0 to 3 | 0 | 1 |
/// | leaf entry 0 | 256 to 259 | 16 | 1 |
/// | polygon 0 | 1280 to 1579 | 80 to 98 | 19 |
/// | triangle 0 | 512 to 587 | 32 to 36 | 5 |
/// | triangle 1 | 588 to 663 | 36 to 41 | 5 |
#[test]
fn the_reads_of_a_quadrilateral_are_those_worked_by_hand() {
    let database = quad();
    let header = &database.database().header;
    let layout = &header.layout;
    // Whole granules: octree, list, two triangles of 76 bytes, two surfaces, a material, a polygon of 300.
    assert_eq!(layout.database_bytes(), 256 + 256 + 256 + 256 + 256 + 512);
    let expected = [
        (Section::OctreeNodes, 0, 1, 1),
        (Section::LeafLists, 256, 1, 1),
        (Section::Triangles, 512, 11, 10),
        (Section::Polygons, 1280, 19, 19),
    ];
    for (section, base, ..) in expected {
        assert_eq!(layout.span(section).base.0, base, "{section:?}");
    }

    let mut cluster = ClusterMemory::new(layout);
    cluster.store(Address(0), database.database().bytes()).expect("in order");
    let replacement = specification::Replacement::Lru;
    let size = MemorySize::Share { numerator: 1, denominator: 1 };
    let settings = specification::LocalMemory { size, line: 16, ways: None, replacement };
    let geometry = Geometry::new(&settings, layout).expect("possible");
    let mut memory = LocalMemory::<Lru, _>::new(geometry, layout, 1, &cluster);
    let (mut hero, mut stats, mut words) = (Hero::new(header, true), TraceStats::default(), Vec::new());
    let ray =
        Ray { origin: [0.25, 0.5, 0.875], direction: [0.0, 0.0, -1.0], t_max: f32::INFINITY, source: Source::Eye };
    let numbers = RecordNumbers::new(layout);
    let mut port = Recorder::new(&mut memory, numbers, &mut words, |_| {});
    let hit = hero.nearest(&mut port, &ray, &mut stats).expect("in range").expect("a hit");
    assert_eq!(hit.t, 0.875);
    assert_eq!((stats.octree_accesses[0], stats.primitive_tests, stats.polygon_triangles), (1, 1, 2));

    let counted = memory.take_stats();
    for (section, _, line_accesses, line_misses) in expected {
        let records = if section == Section::Triangles { 2 } else { 1 };
        let counters = Counters { record_accesses: records, record_misses: records, line_accesses, line_misses };
        assert_eq!(counted.section(section), counters, "{section:?}");
    }
    let all = Counters { record_accesses: 5, record_misses: 5, line_accesses: 32, line_misses: 31 };
    assert_eq!(counted.total(), all);
    // A word, a word, 75 of the polygon, twice 19 of a triangle; 31 lines of four words.
    assert_eq!((counted.words_read(layout), counted.words_moved(16)), (1 + 1 + 75 + 2 * 19, 31 * 4));

    // All of it is there now.
    hero.nearest(&mut memory, &ray, &mut stats).expect("in range");
    assert_eq!(memory.take_stats().total(), Counters { record_misses: 0, line_misses: 0, ..all });

    // In the order in which they are read, and the same counts when they are replayed.
    let number = |section, index| numbers.number(section, index);
    let order = [
        number(Section::OctreeNodes, 0),
        number(Section::LeafLists, 0),
        number(Section::Polygons, 0),
        number(Section::Triangles, 0),
        number(Section::Triangles, 1),
    ];
    assert_eq!(words, order);
    let mut trace = Captured::default();
    trace.push(NodeId(0), TileId(0), [words]);
    let lines = RecordLines::new(layout, 16);
    let (mut replayer, mut sum) = (Replayer::<Lru, _>::new(&lines, geometry, 1).expect("few slots"), Sum::new(&trace));
    replayer.tile(&trace, 0, &mut sum).expect("sound");
    assert_eq!(sum.finish(), all);
}

/// Whether something is in the way is known after the polygon's two triangles: the reads are the same.
#[test]
fn a_shadow_ray_reads_the_polygon_and_its_triangles() {
    let database = quad();
    let mut hero = Hero::new(&database.database().header, true);
    let ray =
        Ray { origin: [0.25, 0.5, 0.875], direction: [0.0, 0.0, -1.0], t_max: f32::INFINITY, source: Source::Eye };
    let mut stats = TraceStats::default();
    let Ok(occluded) = hero.occluded(&mut trace::tracer::slices::Slices::new(&database), &ray, &mut stats);
    assert!(occluded);
    assert_eq!((stats.primitive_tests, stats.polygon_triangles), (1, 2));
}
