//! Primitives without area, twice in one place, or very many in one place.

use glam::DVec3;

use crate::subjects::{Chance, Pieces, Vector, f32s, hits_of, ray, towards};
use trace::tracer::octree::BuildParameters;

/// Cases 21 and 22: triangles without area, be it three points of a line, a vertex twice, or one point, are never
/// hit, even by rays exactly at them; what lies behind is.
#[test]
fn what_has_no_area_is_never_hit() {
    let mut chance = Chance::new(21);
    for _ in 0..20 {
        let (a, step) = (chance.grid_point() * 0.25, chance.grid_point() * 0.0625);
        let step = (step * 1024.0).round() / 1024.0;
        let on_line = |k: i32| f32s(a + step * f64::from(k));
        let degenerate = [
            [on_line(0), on_line(3), on_line(7)],
            [on_line(7), on_line(0), on_line(3)],
            [on_line(0), on_line(0), on_line(5)],
            [on_line(5), on_line(2), on_line(5)],
            [on_line(4), on_line(4), on_line(4)],
        ];
        let pieces = Pieces::of_triangles(degenerate);
        let rays: Vec<_> = (0..160)
            .map(|i| towards(chance.grid_point(), a + step * f64::from(i % 8)))
            .chain((0..20).map(|_| towards(a - step, a)))
            .collect();
        assert!(pieces.hits(&rays).iter().all(Option::is_none), "{degenerate:?}");

        let mut with_wall = pieces.clone();
        with_wall.add_quad([[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, -1.0]]);
        let down: Vec<_> = (0..8)
            .map(|k| {
                let [x, y, _] = on_line(k);
                ray([x, y, 1.0], [0.0, 0.0, -1.0])
            })
            .collect();
        for hit in with_wall.hits(&down) {
            assert!(hit.is_some_and(|hit| hit.primitive.0 >= 5), "{hit:?}");
        }
    }
}

/// Case 23: of duplicates in one plane the lowest id is hit, whatever the tree.
#[test]
fn of_coplanar_duplicates_the_lowest_id_is_hit() {
    let mut chance = Chance::new(23);
    for round in 0..10 {
        let mut pieces = Pieces::default();
        // In the way of none, so that ids are not simply 0.
        for _ in 0..round {
            let at = DVec3::new(0.9, 0.9, 0.9) + chance.point() * 0.01;
            pieces.add([0; 3].map(|_| f32s(at + chance.point() * 0.01)));
        }
        let first = pieces.triangles.len() as u32;
        let vertices = [0; 3].map(|_| f32s(chance.point() * 0.8));
        let [a, b, c] = vertices;
        // The same place, turned and mirrored.
        for copy in [[a, b, c], [b, c, a], [c, b, a], [a, b, c], [a, c, b]] {
            pieces.add(copy);
        }
        let target = |chance: &mut Chance| {
            let (u, v) = (chance.unit().abs() * 0.5, chance.unit().abs() * 0.5);
            let [a, b, c] = vertices.map(|v| DVec3::from(v.map(f64::from)));
            a + (b - a) * u + (c - a) * v
        };
        let rays: Vec<_> = (0..300)
            .map(|_| {
                let origin = chance.point() * 0.8;
                ray(f32s(origin), f32s((target(&mut chance) - origin).normalize()))
            })
            .collect();
        let hits = pieces.hits(&rays);
        let of_stack: Vec<u32> = hits.iter().flatten().map(|hit| hit.primitive.0).filter(|&id| id >= first).collect();
        assert!(of_stack.len() > 200, "{}", of_stack.len());
        let lowest = of_stack.iter().filter(|&&id| id == first).count();
        assert_eq!(lowest, of_stack.len(), "{of_stack:?}");
    }
}

/// Case 26: building a thousand triangles in one place ends, small, however deep it may go.
#[test]
fn a_thousand_coincident_triangles() {
    let place: [Vector; 3] = [[-0.7, -0.6, 0.3], [0.8, -0.5, 0.1], [0.1, 0.9, -0.4]];
    let pieces = Pieces::of_triangles([place; 1000]);
    let rays = [ray([0.1, 0.0, 1.0], [0.0, 0.0, -1.0]), ray([0.9, 0.9, 0.9], [0.0, 0.0, -1.0])];
    for (leaf_size, max_depth) in [(1, 0), (8, 9), (1, 12), (1, 20)] {
        let database = pieces.database(BuildParameters { leaf_size, max_depth });
        assert!(database.database().bytes().len() < 64 << 20, "{} bytes", database.database().bytes().len());
        let hits = hits_of(&database, &rays);
        assert_eq!(hits[0].map(|hit| hit.primitive.0), Some(0));
        assert!(hits[1].is_none());
    }
}
