//! Ray and triangle, exactly: by the sides on which the ray passes the three edges.

use super::determinant::{side, volume_sign};
use crate::database::records::Triangle;
use crate::tracer::primitives::exact::{ExactSum, add_side, volume};
use crate::tracer::ray::Ray;

/// Where the ray hits the triangle: its edges and vertices belong to it; one without area, and one in whose plane
/// the ray runs, is never hit. The result is right to the last places, and its sign exactly.
pub fn hit(ray: &Ray, triangle: &Triangle) -> Option<f64> {
    let [x, y, z] = triangle.coordinates;
    let [a, b, c] = [0, 1, 2].map(|v| [x[v], y[v], z[v]]);
    let (origin, direction) = (ray.origin, ray.direction);
    let edges = [(b, c), (c, a), (a, b)];
    let mut sides = 0u32;
    for (from, to) in edges {
        sides |= 1 << (side(origin, direction, from, to) + 1);
        if sides & 0b101 == 0b101 {
            return None;
        }
    }
    // On no side of any edge: the sum below, the plane's slope against the ray, would be zero.
    if sides == 0b010 {
        return None;
    }
    let mut slope = ExactSum::default();
    for (from, to) in edges {
        add_side(&mut slope, origin, direction, from, to);
    }
    // Passing on the positive side of the edges, the ray meets the plane ahead if the volume is positive too.
    let ahead = volume_sign(origin, [a, b, c]);
    let behind = if sides & 0b100 != 0 { ahead < 0 } else { ahead > 0 };
    (!behind).then(|| (volume(origin, [a, b, c]) / slope.value()).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracer::ray::Source;

    fn depth(origin: [f32; 3], direction: [f32; 3]) -> Option<f64> {
        let triangle = Triangle::new([[0.0, 0.0, 0.5], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]], 0, 0);
        hit(&Ray { origin, direction, t_max: f32::INFINITY, source: Source::Eye }, &triangle)
    }

    #[test]
    fn edges_and_vertices_belong_to_it_and_what_is_behind_does_not() {
        let up = [0.0, 0.0, 2.0];
        let below = f32::from_bits(0.25f32.to_bits() + 1);
        for (x, y, expected) in [
            (0.1, 0.1, Some(0.25)),
            (0.0, 0.0, Some(0.25)),
            (0.25, 0.25, Some(0.25)),
            (0.25, below, None),
            (-1e-40, 0.1, None),
        ] {
            assert_eq!(depth([x, y, 0.0], up), expected, "{x} {y}");
        }
        assert_eq!(depth([0.1, 0.1, 0.5], up), Some(0.0));
        assert_eq!(depth([0.1, 0.1, 0.6], up), None);
        assert_eq!(depth([-0.5, 0.1, 0.5], [1.0, 0.0, 0.0]), None, "in its plane");
    }
}
