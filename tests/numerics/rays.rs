//! Rays that are parallel to something, start on something, or are no rays at all.

use glam::DVec3;
use trace::database::records::{Cone, Sphere};
use trace::oracle::ClosedMesh;
use trace::tracer::hit::Hit;
use trace::tracer::octree::build_database;
use trace::tracer::ray::{Ray, Source};

use crate::subjects::{Chance, Pieces, TREES, bits, f32s, hits_of, ray};

/// Case 5: along each axis, both ways.
#[test]
fn rays_along_axes() {
    let mut chance = Chance::new(5);
    let pieces = chance.soup(200);
    let rays: Vec<_> = (0..1200)
        .map(|i| {
            let mut origin = f32s(chance.point());
            let mut direction = [0.0; 3];
            direction[i % 3] = if i % 2 == 0 { 1.0 } else { -1.0 };
            if i % 4 < 2 {
                origin[i % 3] = -direction[i % 3];
            }
            ray(origin, direction)
        })
        .collect();
    assert!(pieces.hits(&rays).iter().flatten().count() > 500);
}

/// Case 6: a component of −0 is one of +0.
#[test]
fn minus_zero_is_zero() {
    let mut chance = Chance::new(6);
    let pieces = chance.soup(200);
    let rays = |zero: f32| -> Vec<Ray> {
        let mut chance = Chance::new(60);
        (0..600)
            .map(|i| {
                let (mut origin, mut direction) = (f32s(chance.point()), f32s(chance.direction()));
                direction[i % 3] = zero;
                if i % 2 == 0 {
                    direction[(i + 1) % 3] = zero;
                }
                if i % 5 == 0 {
                    origin[i % 3] = zero;
                }
                ray(origin, direction)
            })
            .collect()
    };
    let (plus, minus) = (pieces.hits(&rays(0.0)), pieces.hits(&rays(-0.0)));
    assert_eq!(plus.iter().map(bits).collect::<Vec<_>>(), minus.iter().map(bits).collect::<Vec<_>>());
}

/// Cases 7, 8 and 9: with two components of zero and an origin in planes that divide cells, in the root's faces, or
/// both: along a cell's edge.
#[test]
fn rays_in_planes_and_along_edges_of_cells() {
    let mut chance = Chance::new(7);
    let mut pieces = chance.soup(200);
    // What reaches the root's faces.
    for axis in 0..3 {
        for side in [-1.0f32, 1.0] {
            let corner = |u: f32, v: f32, w: f32| {
                let mut at = [0.0; 3];
                (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (u, v, w);
                at
            };
            let (u, v) = (side * 0.5, side);
            pieces.add_quad([corner(u, 0.25, -1.0), corner(v, 0.25, -1.0), corner(v, 0.25, 1.0), corner(u, 0.25, 1.0)]);
        }
    }
    let mut rays = Vec::new();
    for i in 0..1500 {
        let along = i % 3;
        let mut origin = chance.point();
        let mut direction = DVec3::ZERO;
        direction[along] = if i % 2 == 0 { 1.0 } else { -1.0 };
        let plane = |chance: &mut Chance| f64::from(chance.below(17)) / 8.0 - 1.0;
        match i % 5 {
            0 => origin[(along + 1) % 3] = plane(&mut chance),
            1 => (origin[(along + 1) % 3], origin[(along + 2) % 3]) = (plane(&mut chance), plane(&mut chance)),
            2 => origin[(along + 1) % 3] = if i % 4 < 2 { 1.0 } else { -1.0 },
            3 => {
                // In a plane, but askew in it.
                origin[(along + 1) % 3] = plane(&mut chance);
                direction[(along + 2) % 3] = chance.unit();
            }
            _ => origin = DVec3::splat(0.0),
        }
        rays.push(ray(f32s(origin), f32s(direction.normalize())));
    }
    assert!(pieces.hits(&rays).iter().flatten().count() > 400);
}

/// Cases 7 to 9, but for rounding: along faces and edges of cells within some units in the last place, at what ends
/// just there. HERO's planes are off by more than that: without padding it would walk the cells beside the right ones.
#[test]
fn rays_that_nearly_run_in_planes_of_cells() {
    let mut chance = Chance::new(9);
    let mut hits = 0;
    for round in 0..24 {
        let axis = round % 3;
        // Near the middle, where f32 is finer than the rounding of planes.
        let plane = [0.0, 1.0 / 64.0, -1.0 / 16.0, 0.125][round % 4];
        let beside = |chance: &mut Chance| plane + (chance.below(17) as f32 - 8.0) * f32::EPSILON / 32.0;
        // By the axis across the plane, the one along the ray, and the third.
        let place = |across: f32, along: f32, third: f32| {
            let mut at = [0.0; 3];
            (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (across, along, third);
            at
        };
        let mut pieces = Pieces::default();
        for _ in 0..40 {
            let (along, third) = (chance.unit() as f32 * 0.9, chance.unit() as f32 * 0.9);
            let (near, near_too) = (beside(&mut chance), beside(&mut chance));
            let far = plane + if chance.below(2) == 0 { 0.05 } else { -0.05 };
            pieces.add([
                place(near, along, third - 0.02),
                place(near_too, along + 0.01, third + 0.02),
                place(far, along, third),
            ]);
        }
        let rays: Vec<_> = (0..400)
            .map(|i| {
                let target = &pieces.triangles[i % 40].vertices();
                let third = target[2][(axis + 2) % 3] as f32 + chance.unit() as f32 * 0.02;
                let slope = (chance.unit() * 10f64.powf(-5.0 - f64::from(chance.below(40)) / 10.0)) as f32;
                let side = if i % 2 == 0 { 1.0 } else { -1.0 };
                ray(place(beside(&mut chance), -side, third), place(slope, side, 0.0))
            })
            .collect();
        hits += pieces.hits(&rays).iter().flatten().count();
    }
    assert!(hits > 2000, "{hits}");
}

/// Case 8: what touches the root's face is hit by a ray in that face.
#[test]
fn a_ray_in_the_roots_face_hits_what_touches_it() {
    for side in [-1.0f32, 1.0] {
        let touching = [[side, -0.5, 0.0], [side, 0.5, 0.0], [0.0, 0.0, 0.0]];
        let pieces = Pieces::of_triangles([touching]);
        assert_eq!(pieces.hit(ray([side, 0.125, -1.0], [0.0, 0.0, 1.0])), Some((1.0, 0)));
        assert_eq!(pieces.hit(ray([side, 0.125, 1.0], [-0.0, 0.0, -1.0])), Some((1.0, 0)));
        assert_eq!(pieces.hit(ray([-side, 0.125, 1.0], [0.0, 0.0, -1.0])), None);
    }
}

/// Cases 10 and 11: along the root's diagonals, through its centre, and from its centre.
#[test]
fn rays_through_and_from_the_centre() {
    let mut chance = Chance::new(10);
    let mut pieces = chance.soup(100);
    // Through the centre, and round it.
    pieces.add([[-0.25, 0.25, 0.0], [0.25, 0.0, -0.25], [0.0, -0.25, 0.25]]);
    pieces.add([[0.5, 0.5, 0.5], [0.5, 0.75, 0.25], [0.25, 0.5, 0.75]]);
    let mut rays = Vec::new();
    for i in 0..8u32 {
        let sign = |axis: u32| if i >> axis & 1 == 0 { 1.0 } else { -1.0 };
        let corner = [sign(0), sign(1), sign(2)];
        let inward = corner.map(|c: f32| -c);
        let unit = f32s(DVec3::from(inward.map(f64::from)).normalize());
        rays.extend([ray(corner, inward), ray(corner, unit), ray([0.0; 3], inward), ray([-0.0; 3], unit)]);
    }
    rays.extend((0..500).map(|_| ray([0.0; 3], f32s(chance.direction()))));
    assert!(pieces.hits(&rays).iter().flatten().count() > 200);
}

/// Case 12: a ray that starts outside and points away, or starts in a face and leaves, hits nothing.
#[test]
fn rays_that_point_away_hit_nothing() {
    let mut chance = Chance::new(12);
    let pieces = chance.soup(100);
    let mut rays = Vec::new();
    for i in 0..300 {
        let outward = chance.direction();
        assert!(Ray::from_eye(outward * 2.0, outward).is_none());
        assert!(Ray::from_eye(outward * 1e6, chance.direction() + outward).is_none());
        let mut at = f32s(chance.point() * 0.999);
        let mut direction = f32s(outward);
        // Beyond the face itself, so that not even what lies in it is hit.
        at[i % 3] = (1.0 + (i / 3) as f32).copysign(direction[i % 3]).next_up();
        if at[i % 3] < 0.0 {
            at[i % 3] = at[i % 3].next_down().next_down();
        }
        if i % 2 == 0 {
            direction = [0.0; 3];
            direction[i % 3] = 1f32.copysign(at[i % 3]);
        }
        rays.push(ray(at, direction));
    }
    for tree in TREES {
        assert!(hits_of(&pieces.database(tree), &rays).iter().all(Option::is_none));
    }
}

/// Case 13: a ray that leaves a surface does not hit it at its origin; a sphere's and a cone's far side it does.
#[test]
fn what_a_ray_leaves_from_is_not_hit_at_the_origin() {
    let mut chance = Chance::new(13);
    let mut pieces = Pieces::default();
    for _ in 0..40 {
        let at = chance.point() * 0.6;
        pieces.add([0; 3].map(|_| f32s(at + chance.point() * 0.2)));
        pieces.spheres.push(Sphere { centre: f32s(chance.point() * 0.6), radius: (chance.unit().abs() * 0.2) as f32 });
        let base = chance.point() * 0.6;
        pieces.cones.push(Cone {
            base: f32s(base),
            base_radius: 0.1,
            apex: f32s(base + chance.point() * 0.3),
            apex_radius: (chance.unit().abs() * 0.1) as f32,
        });
    }
    let first: Vec<Ray> = (0..1500).map(|_| ray(f32s(chance.point()), f32s(chance.direction()))).collect();
    let surfaces: Vec<(Ray, Hit)> =
        first.iter().zip(pieces.hits(&first)).filter_map(|(ray, hit)| hit.map(|hit| (*ray, hit))).collect();
    let mut leaving = Vec::new();
    for (ray, hit) in &surfaces {
        let point = hit.surface_point(ray);
        // Outward, inward, and nearly along the surface.
        for direction in [chance.direction(), -point.normal, point.normal.any_orthonormal_vector()] {
            leaving.push((point.leaving(direction, f32::INFINITY), point));
        }
    }
    let rays: Vec<Ray> = leaving.iter().map(|(ray, _)| *ray).collect();
    let hits = pieces.hits(&rays);
    let (mut through, mut own) = (0, 0);
    for ((ray, point), hit) in leaving.iter().zip(&hits) {
        let Some(hit) = hit else { continue };
        match point.source {
            Source::Polygon(polygon) => assert_ne!(hit.primitive.0, polygon, "{ray:?}"),
            Source::Curved(id) if id == hit.primitive.0 => {
                own += 1;
                let is_sphere = (id as usize) < pieces.triangles.len() + pieces.spheres.len();
                let inward = ray.direction_f64().dot(point.normal);
                if is_sphere && inward < -0.1 {
                    // The chord: twice the radius times the cosine, but for the origin's offset.
                    let radius = f64::from(pieces.spheres[id as usize - pieces.triangles.len()].radius.abs());
                    let chord = -2.0 * radius * inward;
                    assert!((f64::from(hit.t) - chord).abs() < 1e-5, "{} for {chord}, {ray:?}", hit.t);
                    through += 1;
                }
                assert!(inward < 1e-3, "{ray:?} leaves outward and hits {id} again at {}", hit.t);
            }
            _ => {}
        }
    }
    assert!(through > 20 && own > through, "{through} through spheres of {own} through their own");
}

/// Case 13 at edges: what leaves a convex surface on its outer side meets none of it, neither the neighbours of the
/// triangle that it leaves from, though its origin is rounded.
#[test]
fn what_leaves_a_convex_surface_does_not_meet_it_again() {
    let mut chance = Chance::new(130);
    let scene = ClosedMesh::icosahedron(3).scene();
    let database = build_database(&scene, TREES[2]).expect("builds");
    let triangles: Vec<[DVec3; 3]> =
        scene.polygons.iter().map(|p| scene.corners(p).try_into().expect("three")).collect();
    let mut rays = Vec::new();
    for (polygon, &[a, b, c]) in triangles.iter().enumerate() {
        let normal = (b - a).cross(c - a).normalize();
        let normal = if normal.dot(a) < 0.0 { -normal } else { normal };
        assert!(scene.vertices.iter().all(|&v| (v - a).dot(normal) < 1e-12), "a convex mesh");
        for i in 0..12 {
            // A vertex, the middle of an edge, a point very near to one, or any.
            let share = [0.0, 0.5, 1e-8, chance.unit().abs()][i % 4];
            let point = a + (b - a) * share + (c - a) * [0.0, 1e-8, 0.2][i % 3] * (1.0 - share);
            let along = normal.any_orthonormal_vector() * chance.unit();
            let direction = [chance.direction(), normal.cross(along) + normal * 1e-3 + along][i % 2].normalize();
            let outward = if direction.dot(normal) < 0.0 { -direction } else { direction };
            let source = Source::Polygon(polygon as u32);
            rays.push(Ray::leaving(point, normal, outward, f32::INFINITY, source));
        }
    }
    assert!(hits_of(&database, &rays).iter().all(Option::is_none));
}

/// Case 14: a direction of denormals is none; one such component beside others is exact; the length of a direction
/// does not change what it hits.
#[test]
fn denormal_and_short_directions() {
    let mut chance = Chance::new(14);
    let pieces = chance.soup(200);
    let denormal: Vec<_> = (0..200)
        .map(|_| ray(f32s(chance.point()), f32s(chance.direction()).map(|d| d * f32::MIN_POSITIVE * 0.9)))
        .collect();
    assert!(pieces.hits(&denormal).iter().all(Option::is_none));
    let mixed: Vec<_> = (0..600)
        .map(|i| {
            let mut direction = f32s(chance.direction());
            direction[i % 3] = [1e-42, -1e-45, f32::MIN_POSITIVE, -1.1e-38, 1e-37, -1e-30][i % 6];
            ray(f32s(chance.point()), direction)
        })
        .collect();
    assert!(pieces.hits(&mixed).iter().flatten().count() > 200);
    let unit: Vec<_> = (0..400).map(|_| ray(f32s(chance.point()), f32s(chance.direction()))).collect();
    let expected = pieces.hits(&unit);
    for power in [-60, -20, 20] {
        let factor = 2f32.powi(power);
        let scaled: Vec<_> = unit.iter().map(|r| Ray { direction: r.direction.map(|d| d * factor), ..*r }).collect();
        for (hit, expected) in pieces.hits(&scaled).iter().zip(&expected) {
            let shortened = hit.map(|hit| ((hit.t * factor).to_bits(), hit.primitive.0));
            assert_eq!(shortened, bits(expected), "2^{power}");
        }
    }
}

/// Case 15: a ray with NaN or an infinity in it hits nothing. That it is counted is [`crate::shading`]'s part: what
/// such a ray would bring is a radiance, and one that is not finite is reported.
#[test]
fn rays_that_are_not_finite_hit_nothing() {
    let mut chance = Chance::new(15);
    let mut pieces = chance.soup(300);
    pieces.spheres.push(Sphere { centre: [0.0; 3], radius: 0.9 });
    let mut rays = Vec::new();
    for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for place in 0..6 {
            for other in 0..8 {
                let mut numbers = [[0.1, 0.2, 0.3], [0.5, -0.4, 0.6]];
                if other & 1 == 1 {
                    numbers[1] = [0.0; 3];
                }
                if other & 2 == 2 {
                    numbers[1][(place + 1) % 3] = -1.0;
                }
                if other & 4 == 4 {
                    numbers[(place / 3 + 1) % 2][place % 3] = bad;
                }
                numbers[place / 3][place % 3] = bad;
                rays.push(ray(numbers[0], numbers[1]));
            }
        }
    }
    rays.push(Ray { t_max: f32::NAN, ..ray([0.0; 3], [0.0, 0.0, 1.0]) });
    rays.push(ray([0.1, 0.2, 0.3], [0.0; 3]));
    rays.push(ray([0.1, 0.2, 0.3], [-0.0; 3]));
    assert!(pieces.hits(&rays).iter().all(Option::is_none));
}

/// Case 29: a shadow ray ends at the light: what is there or beyond does not shadow.
#[test]
fn a_shadow_ray_ends_at_the_light() {
    let mut pieces = Pieces::default();
    pieces.add_quad([[-0.5, -0.5, 0.5], [0.5, -0.5, 0.5], [0.5, 0.5, 0.5], [-0.5, 0.5, 0.5]]);
    pieces.spheres.push(Sphere { centre: [0.75, 0.75, 0.75], radius: 0.125 });
    let up = |t_max: f32| Ray { t_max, ..ray([0.1, 0.2, -0.5], [0.0, 0.0, 1.0]) };
    assert_eq!(pieces.hit(up(1.0)), None, "at the light");
    assert_eq!(pieces.hit(up(1f32.next_down())), None, "beyond it");
    assert_eq!(pieces.hit(up(1f32.next_up())).map(|hit| hit.0), Some(1.0), "before it");
    for t_max in [0.0, -1.0, f32::NEG_INFINITY, 0.5] {
        assert_eq!(pieces.hit(up(t_max)), None, "{t_max}");
    }
    let mut chance = Chance::new(29);
    let soup = chance.soup(200);
    let far: Vec<_> = (0..500).map(|_| ray(f32s(chance.point()), f32s(chance.direction()))).collect();
    let hits = soup.hits(&far);
    // Ending where the nearest hit is, and just behind it.
    for (past, expected) in [(0, false), (1, true)] {
        let shadow: Vec<_> = far
            .iter()
            .zip(&hits)
            .filter_map(|(ray, hit)| hit.map(|hit| Ray { t_max: f32::from_bits(hit.t.to_bits() + past), ..*ray }))
            .collect();
        assert!(soup.hits(&shadow).iter().all(|hit| hit.is_some() == expected));
    }
}
