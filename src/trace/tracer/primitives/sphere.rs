//! Ray and sphere intersection.

use glam::DVec3;

use crate::database::records::Sphere;
use crate::tracer::ray::Ray;

/// The nearest visible root at or after the origin. `leaving`: the ray starts on this sphere, so the root
/// nearest to zero is its origin and no hit.
pub fn intersect(ray: &Ray, sphere: &Sphere, leaving: bool) -> Option<f64> {
    let direction = ray.direction_f64();
    let from_centre = ray.origin_f64() - DVec3::from(sphere.centre.map(f64::from));
    let radius = f64::from(sphere.radius);
    let a = direction.dot(direction);
    let half_b = from_centre.dot(direction);
    // The discriminant by the distance of the centre from the ray: no cancellation for a distant sphere
    // (E. Haines et al., Ray Tracing Gems, chapter 7).
    let closest = from_centre - direction * (half_b / a);
    let discriminant = radius * radius - closest.dot(closest);
    if !(discriminant >= 0.0) {
        return None;
    }
    let root = (discriminant * a).sqrt();
    let c = from_centre.dot(from_centre) - radius * radius;
    let q = if half_b > 0.0 { -half_b - root } else { -half_b + root };
    let (r0, r1) = if q == 0.0 { (0.0, 0.0) } else { (c / q, q / a) };
    let roots = if r0 < r1 { [r0, r1] } else { [r1, r0] };
    nearest_visible(roots, [sphere.radius > 0.0, true], leaving)
}

/// Of two roots in ascending order, the first that is a hit.
pub(super) fn nearest_visible(roots: [f64; 2], visible: [bool; 2], leaving: bool) -> Option<f64> {
    let origin = if roots[0].abs() <= roots[1].abs() { 0 } else { 1 };
    let counts = |&i: &usize| visible[i] && roots[i] >= 0.0 && !(leaving && i == origin);
    [0, 1].into_iter().find(counts).map(|i| roots[i])
}
