//! Ray and sphere, cone or cylinder, in f64 with a bound on the error of each depth. What rounding could decide
//! either way, a grazing ray above all, is marked as uncertain.

use glam::DVec3;

use crate::database::records::{Cone, Sphere};
use crate::tracer::ray::Ray;

/// A point where the ray's line meets the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    pub t: f64,
    /// The true depth is within this of `t`.
    pub error: f64,
    /// False: there may be no crossing at all.
    pub certain: bool,
}

/// Bound of the relative error of what is computed here, some tens of roundings.
const ROUNDING: f64 = 1e-14;

/// The crossings that count as hits. `leaving`: the ray starts on this very sphere.
pub fn sphere_hits(ray: &Ray, sphere: &Sphere, leaving: bool) -> Vec<Crossing> {
    let direction = ray.direction_f64();
    let from_centre = ray.origin_f64() - DVec3::from(sphere.centre.map(f64::from));
    let radius = f64::from(sphere.radius.abs());
    let speed = direction.length();
    let distance = from_centre.cross(direction).length() / speed;
    let error = ROUNDING * (from_centre.length() + radius);
    if !(distance <= radius + error) {
        return Vec::new();
    }
    let middle = -from_centre.dot(direction) / (speed * speed);
    let half_chord = ((radius - distance).max(0.0) * (radius + distance)).sqrt();
    let grazing = radius - distance <= error;
    // Half the chord squared is off by `error` times the diameter.
    let chord_error = (2.0 * error * (radius + distance + error) / half_chord.max(f64::MIN_POSITIVE))
        .min((2.0 * error * (radius + distance + error)).sqrt());
    let crossing = |sign: f64| Crossing {
        t: middle + sign * half_chord / speed,
        error: (chord_error + error) / speed,
        certain: !grazing,
    };
    hits([crossing(-1.0), crossing(1.0)], [sphere.radius > 0.0, true], leaving)
}

/// The crossings that count as hits, between base and apex. `leaving`: the ray starts on this very cone.
pub fn cone_hits(ray: &Ray, cone: &Cone, leaving: bool) -> Vec<Crossing> {
    let base = DVec3::from(cone.base.map(f64::from));
    let axis = DVec3::from(cone.apex.map(f64::from)) - base;
    let (direction, from_base) = (ray.direction_f64(), ray.origin_f64() - base);
    let length = axis.length();
    // Heights as shares of the axis; the axis' cross products give what is perpendicular to it.
    let (height, climb) = (from_base.dot(axis) / (length * length), direction.dot(axis) / (length * length));
    let (p, dp) = (from_base.cross(axis) / length, direction.cross(axis) / length);
    let base_radius = f64::from(cone.base_radius.abs());
    let taper = f64::from(cone.apex_radius.abs()) - base_radius;
    let (radius, widening) = (base_radius + taper * height, taper * climb);
    let a = dp.length_squared() - widening * widening;
    let half_b = p.dot(dp) - radius * widening;
    let c = p.length_squared() - radius * radius;
    let size = from_base.length() + radius.abs() + base_radius;
    let pace = direction.length() + widening.abs();
    let [a_error, b_error, c_error] = [pace * pace, pace * size, size * size].map(|magnitude| ROUNDING * magnitude);
    let discriminant = half_b * half_b - a * c;
    let discriminant_error =
        2.0 * half_b.abs() * b_error + a.abs() * c_error + c.abs() * a_error + ROUNDING * half_b * half_b;
    if !(discriminant >= -discriminant_error) {
        return Vec::new();
    }
    let root = discriminant.max(0.0).sqrt();
    let q = if half_b > 0.0 { -half_b - root } else { -half_b + root };
    // Whether the height at `t` may be, and whether it surely is, between base and apex.
    let place = |t: f64, error: f64| {
        let (at, fuzz) = (height + climb * t, error * climb.abs() + ROUNDING * (1.0 + size / length));
        (at >= -fuzz && at <= 1.0 + fuzz, at > fuzz && at < 1.0 - fuzz)
    };
    let crossing = |t: f64| {
        // How far a root moves with the coefficients: by the derivative there, or near a double root by the square
        // root of the discriminant's error.
        let residual = a_error * t * t + 2.0 * b_error * t.abs() + c_error;
        let slack = discriminant_error.sqrt() / a.abs().max(f64::MIN_POSITIVE);
        let error = (residual / (2.0 * root).max(f64::MIN_POSITIVE)).min(slack) + ROUNDING * t.abs();
        Crossing { t, error, certain: place(t, error).1 && discriminant > discriminant_error }
    };
    let inside_only = cone.base_radius < 0.0 || cone.apex_radius < 0.0;
    // The distance from the surface falls at an entry: a·t + half_b is negative there.
    let entering = |t: f64| a * t + half_b < 0.0;
    let mut roots = [c / q, q / a];
    roots.sort_by(f64::total_cmp);
    let crossings = roots.map(crossing);
    let shown = crossings.map(|c| c.t.is_finite() && place(c.t, c.error).0 && !(inside_only && entering(c.t)));
    hits(crossings, shown, leaving)
}

/// Those of two crossings that lie ahead and are shown; when leaving, not the one that is the origin.
fn hits(crossings: [Crossing; 2], shown: [bool; 2], leaving: bool) -> Vec<Crossing> {
    let [first, second] = crossings.map(|c| c.t.abs());
    let doubt = crossings[0].error + crossings[1].error;
    [0, 1]
        .into_iter()
        .filter(|&i| shown[i])
        .filter_map(|i| {
            let mut crossing = crossings[i];
            let is_origin = if i == 0 { first <= second + doubt } else { second <= first + doubt };
            let may_be_other = (first - second).abs() <= doubt;
            if leaving && is_origin {
                if !may_be_other {
                    return None;
                }
                crossing.certain = false;
            }
            crossing.certain &= crossing.t > crossing.error;
            (crossing.t >= -crossing.error).then_some(crossing)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracer::ray::Source;

    fn along_x(y: f32) -> Ray {
        Ray { origin: [-1.0, y, 0.0], direction: [1.0, 0.0, 0.0], t_max: f32::INFINITY, source: Source::Eye }
    }

    fn depths(crossings: &[Crossing]) -> Vec<f64> {
        crossings.iter().map(|c| (c.t * 1e9).round() / 1e9).collect()
    }

    #[test]
    fn a_sphere_is_entered_and_left() {
        let sphere = Sphere { centre: [0.0; 3], radius: 0.5 };
        assert_eq!(depths(&sphere_hits(&along_x(0.0), &sphere, false)), [0.5, 1.5]);
        assert!(sphere_hits(&along_x(0.6), &sphere, false).is_empty());
        assert!(sphere_hits(&along_x(0.5), &sphere, false).iter().all(|c| !c.certain));
        let inside_only = Sphere { radius: -0.5, ..sphere };
        assert_eq!(depths(&sphere_hits(&along_x(0.0), &inside_only, false)), [1.5]);
        let on_it = Ray { origin: [-0.5, 0.0, 0.0], ..along_x(0.0) };
        assert_eq!(depths(&sphere_hits(&on_it, &sphere, true)), [1.0]);
    }

    #[test]
    fn a_cone_is_hit_between_its_ends() {
        let cone = Cone { base: [0.0, 0.0, -0.5], base_radius: 0.5, apex: [0.0, 0.0, 0.5], apex_radius: 0.0 };
        assert_eq!(depths(&cone_hits(&along_x(0.0), &cone, false)), [0.75, 1.25]);
        let above = Ray { origin: [-1.0, 0.0, 0.6], ..along_x(0.0) };
        assert!(cone_hits(&above, &cone, false).is_empty());
        let cylinder = Cone { apex_radius: 0.5, ..cone };
        assert_eq!(depths(&cone_hits(&along_x(0.375), &cylinder, false)), [0.669281086, 1.330718914]);
        let inside_only = Cone { base_radius: -0.5, apex_radius: -0.5, ..cone };
        assert_eq!(depths(&cone_hits(&along_x(0.375), &inside_only, false)), [1.330718914]);
    }
}
