//! Rays through edges, vertices and slivers, and along surfaces.

use glam::DVec3;

use crate::subjects::{Chance, Pieces, Vector, f32s, ray, towards};

/// Case 1: a ray exactly at a point of an edge that two triangles share hits.
#[test]
fn a_shared_edge_is_hit() {
    let mut chance = Chance::new(1);
    for _ in 0..30 {
        let (a, step) = (chance.grid_point() * 0.5, chance.grid_point() / 32.0);
        let b = a + (step * 1024.0).round() / 1024.0 * 16.0;
        let (c, d) = (chance.grid_point(), chance.grid_point());
        let pieces = Pieces::of_triangles([[a, b, c], [b, a, d]].map(|t| t.map(f32s)));
        let rays: Vec<_> =
            (0..170).map(|i| towards(chance.grid_point(), a + (b - a) * f64::from(i % 17) / 16.0)).collect();
        for (hit, ray) in pieces.hits(&rays).iter().zip(&rays) {
            assert!(hit.is_some(), "{ray:?} slips through {pieces:?}");
        }
    }
}

/// Case 2: a ray at the hub of a fan of 48 triangles hits, be it aimed exactly or as near as can be.
#[test]
fn the_hub_of_a_fan_is_hit() {
    let mut chance = Chance::new(2);
    for _ in 0..8 {
        let hub = chance.grid_point() * 0.5;
        let (side, up) = (chance.direction() * 0.4, chance.direction() * 0.4);
        let rim = |i: usize| {
            let turn = (i % 48) as f64 / 48.0 * std::f64::consts::TAU;
            hub + side * turn.cos() + up * turn.sin()
        };
        let pieces = Pieces::of_triangles((0..48).map(|i| [hub, rim(i), rim(i + 1)].map(f32s)));
        let rays: Vec<_> = (0..200)
            .map(|i| {
                let origin = chance.grid_point();
                if i % 2 == 0 {
                    towards(origin, hub)
                } else {
                    // Beside the hub by rounding only, and aimed back through it from a little farther away.
                    let unit = (hub - origin).normalize_or(DVec3::X);
                    ray(f32s(hub - unit * 0.3), f32s(unit))
                }
            })
            .collect();
        for (hit, ray) in pieces.hits(&rays).iter().zip(&rays) {
            assert!(hit.is_some(), "{ray:?} slips through the fan at {hub}");
        }
    }
}

/// Case 4: the outer boundary belongs to a triangle, and nothing beyond it does, however near.
#[test]
fn the_boundary_belongs_to_the_triangle() {
    let pieces = Pieces::of_triangles([[[-0.5, -0.5, 0.25], [0.5, -0.5, 0.25], [-0.5, 0.5, 0.25]]]);
    let up = |x: f32, y: f32| ray([x, y, -0.75], [0.0, 0.0, 1.0]);
    for i in 0..=16 {
        let at = i as f32 / 16.0 - 0.5;
        for (x, y, outward) in [(at, -0.5, [0.0, -1.0]), (-0.5, at, [-1.0, 0.0]), (at, -at, [1.0, 0.0])] {
            assert_eq!(pieces.hit(up(x, y)), Some((1.0, 0)), "{x} {y}");
            let beyond = |x: f32, side: f32| match side {
                s if s > 0.0 => x.next_up(),
                s if s < 0.0 => x.next_down(),
                _ => x,
            };
            let outside = up(beyond(x, outward[0]), beyond(y, outward[1]));
            assert_eq!(pieces.hit(outside), None, "{outside:?}");
        }
    }
    // From anywhere, exactly at a vertex.
    let mut chance = Chance::new(4);
    let rays: Vec<_> = (0..300)
        .map(|i| {
            let [x, y] = [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]][i % 3];
            let mut origin = chance.grid_point();
            if origin.z == 0.25 {
                origin.z = 0.5;
            }
            towards(origin, DVec3::new(x, y, 0.25))
        })
        .collect();
    assert!(pieces.hits(&rays).iter().all(Option::is_some));
}

/// Case 27: a polygon in a plane that divides cells is hit from both sides.
#[test]
fn a_polygon_in_a_split_plane_is_hit_from_both_sides() {
    let mut chance = Chance::new(27);
    for axis in 0..3 {
        for plane in [0.0, 0.5, -0.75, 0.015625] {
            let corner = |u: f32, v: f32| {
                let mut at = [0.0; 3];
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (plane, u, v);
                at
            };
            let mut pieces = Pieces::default();
            pieces.add_quad([corner(-0.9, -0.9), corner(0.9, -0.9), corner(0.9, 0.9), corner(-0.9, 0.9)]);
            // So that cells are divided.
            for _ in 0..8 {
                let at = chance.point() * 0.5;
                pieces.add([0; 3].map(|_| f32s(at + chance.point() * 1e-4)));
            }
            let mut rays = Vec::new();
            for i in 0..100 {
                let mut origin = chance.point() * 0.9;
                let mut target = chance.point() * 0.9;
                origin[axis] = if i % 2 == 0 { 1.0 } else { -1.0 };
                target[axis] = f64::from(plane);
                let direction =
                    if i % 5 == 0 { DVec3::AXES[axis] * -origin[axis] } else { (target - origin).normalize() };
                rays.push(ray(f32s(origin), f32s(direction)));
            }
            assert!(pieces.hits(&rays).iter().all(Option::is_some), "axis {axis}, plane {plane}");
        }
    }
}

/// Case 20: slivers a million times as long as wide are hit where they are, and nowhere else.
#[test]
fn slivers_are_hit_where_they_are() {
    let mut chance = Chance::new(20);
    let (mut hits, mut rays_shot) = (0, 0);
    for _ in 0..60 {
        let (a, along, aside) = (chance.point() * 0.5, chance.direction() * 0.4, chance.direction());
        let thin = [a, a + along, a + along * 0.5 + aside * 0.4e-6].map(f32s);
        let pieces = Pieces::of_triangles([thin]);
        let inside = pieces.triangles[0].vertices().iter().sum::<DVec3>() / 3.0;
        let rays: Vec<_> = (0..100)
            .map(|i| {
                let origin = chance.point();
                let beside = chance.point() * [0.0, 1e-8, 1e-7, 1e-3][i % 4];
                let target = inside + along * chance.unit() * 0.3 + beside;
                ray(f32s(origin), f32s((target - origin).normalize()))
            })
            .collect();
        hits += pieces.hits(&rays).iter().flatten().count();
        rays_shot += rays.len();
    }
    assert!(hits > rays_shot / 20 && hits < rays_shot, "{hits} of {rays_shot}");
}

/// Case 24: a ray that meets a surface at 1e-7 rad.
#[test]
fn grazing_rays_hit_what_they_graze() {
    let mut chance = Chance::new(24);
    let mut pieces = Pieces::default();
    pieces.add_quad([[-0.9, -0.9, 0.1], [0.9, -0.9, 0.1], [0.9, 0.9, 0.1], [-0.9, 0.9, 0.1]]);
    let mut rays = Vec::new();
    for i in 0..2000 {
        let (x, y) = (chance.unit() * 0.5, chance.unit() * 0.5);
        let turn = chance.unit() * std::f64::consts::PI;
        let slope = 1e-7 * (1.0 + chance.unit().abs());
        // Some units in the last place above or below the surface, going towards it.
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        let height = f64::from(0.1f32) + side * f64::from(f32::EPSILON) / 16.0 * f64::from(1 + i % 4);
        rays.push(ray(f32s(DVec3::new(x, y, height)), f32s(DVec3::new(turn.cos(), turn.sin(), -side * slope))));
    }
    let hits = pieces.hits(&rays).iter().flatten().count();
    assert!(hits > 1000, "{hits}");
}

/// Case 25: a ray in the plane of a triangle does not hit it.
#[test]
fn a_ray_in_the_plane_does_not_hit() {
    let mut chance = Chance::new(25);
    // All in the plane x + y + z = 0, and all in the plane z = 0.25.
    let oblique = |u: f64, v: f64| DVec3::new(u, v, -u - v);
    let flat = |u: f64, v: f64| DVec3::new(u, v, 0.25);
    let planes: [&dyn Fn(f64, f64) -> DVec3; 2] = [&oblique, &flat];
    for plane in planes {
        let mut on_plane = || {
            let point = chance.grid_point() * 0.5;
            plane(point.x, point.y)
        };
        for _ in 0..40 {
            let pieces = Pieces::of_triangles([[on_plane(), on_plane(), on_plane()].map(f32s)]);
            let rays: Vec<_> = (0..50).map(|_| towards(on_plane(), on_plane())).collect();
            for (hit, ray) in pieces.hits(&rays).iter().zip(&rays) {
                assert!(hit.is_none(), "{ray:?} hits {pieces:?}");
            }
        }
    }
}

/// Case 25, what stands in its place: seen from the edge, what lies behind a flat triangle is hit.
#[test]
fn what_lies_behind_a_triangle_seen_from_its_edge_is_hit() {
    let wall: [Vector; 3] = [[-0.9, -0.9, -0.9], [0.9, -0.9, -0.9], [0.0, 0.9, -0.9]];
    let edge_on: [Vector; 3] = [[0.0, -0.5, -0.5], [0.0, 0.5, -0.5], [0.0, 0.0, 0.5]];
    let pieces = Pieces::of_triangles([edge_on, wall]);
    assert_eq!(pieces.hit(ray([0.0, 0.0, 0.9], [0.0, 0.0, -1.0])).map(|hit| hit.1), Some(1));
    assert_eq!(pieces.hit(ray([0.0, 0.0, 0.9], [-0.0, 0.0, -1.0])).map(|hit| hit.1), Some(1));
}
