//! Ray and open cone or cylinder intersection.

use glam::DVec3;

use super::sphere::nearest_visible;
use crate::database::records::Cone;
use crate::tracer::ray::Ray;

/// A cone in f64: at height `h` along the unit axis from the base, the radius is `radius + slope · h`.
struct Frame {
    base: DVec3,
    axis: DVec3,
    height: f64,
    radius: f64,
    slope: f64,
}

impl Frame {
    fn new(cone: &Cone) -> Self {
        let base = DVec3::from(cone.base.map(f64::from));
        let along = DVec3::from(cone.apex.map(f64::from)) - base;
        let height = along.length();
        let radius = f64::from(cone.base_radius.abs());
        Self {
            base,
            axis: along / height,
            height,
            radius,
            slope: (f64::from(cone.apex_radius.abs()) - radius) / height,
        }
    }

    fn height_of(&self, position: DVec3) -> f64 {
        (position - self.base).dot(self.axis)
    }

    /// Gradient of distance² from the axis minus radius², halved: points outward.
    fn outward(&self, position: DVec3) -> DVec3 {
        let height = self.height_of(position);
        let from_axis = position - self.base - self.axis * height;
        from_axis - self.axis * (self.slope * (self.radius + self.slope * height))
    }
}

/// Unit outward normal at a point of the surface.
pub fn normal(cone: &Cone, position: DVec3) -> DVec3 {
    Frame::new(cone).outward(position).normalize_or_zero()
}

/// The nearest visible root at or after the origin, between base and apex. `leaving` as for a sphere.
pub fn intersect(ray: &Ray, cone: &Cone, leaving: bool) -> Option<f64> {
    let frame = Frame::new(cone);
    let (origin, direction) = (ray.origin_f64(), ray.direction_f64());
    let from_base = origin - frame.base;
    let (h, dh) = (from_base.dot(frame.axis), direction.dot(frame.axis));
    let (p, dp) = (from_base - frame.axis * h, direction - frame.axis * dh);
    let (r, dr) = (frame.radius + frame.slope * h, frame.slope * dh);
    let a = dp.dot(dp) - dr * dr;
    let half_b = p.dot(dp) - r * dr;
    let c = p.dot(p) - r * r;
    let roots = quadratic_roots(a, half_b, c)?;
    let inside_only = cone.base_radius < 0.0 || cone.apex_radius < 0.0;
    let visible = |t: f64| {
        let from_outside = direction.dot(frame.outward(origin + direction * t)) < 0.0;
        (0.0..=frame.height).contains(&(h + dh * t)) && !(inside_only && from_outside)
    };
    nearest_visible(roots, roots.map(visible), leaving)
}

/// Roots of a·t² + 2·half_b·t + c in ascending order, by the form that does not cancel.
fn quadratic_roots(a: f64, half_b: f64, c: f64) -> Option<[f64; 2]> {
    let discriminant = half_b * half_b - a * c;
    if !(discriminant >= 0.0) {
        return None;
    }
    let root = discriminant.sqrt();
    let q = if half_b > 0.0 { -half_b - root } else { -half_b + root };
    // A ray parallel to the surface's lines has a single root; the other is at infinity.
    let (r0, r1) = (c / q, if a == 0.0 { f64::INFINITY } else { q / a });
    Some(if r0 < r1 { [r0, r1] } else { [r1, r0] })
}
