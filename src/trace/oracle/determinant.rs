//! Signs of determinants by the predicate `orient3d` of the crate `robust`, which is exact.

use glam::DVec3;
use robust::{Coord3D, orient3d};

use crate::tracer::primitives::exact::{ExactSum, Vector, add_side};

/// The sign, −1, 0 or 1, of what [`add_side`] adds: by `orient3d` where both differences fit into f64, which is
/// nearly always, else by the exact sum.
pub fn side(origin: Vector, direction: Vector, a: Vector, b: Vector) -> i32 {
    let determinant = match (difference(a, origin), difference(b, origin)) {
        (Some(a), Some(b)) => orient3d(coord(wide(direction)), coord(a), coord(b), coord(DVec3::ZERO)),
        _ => {
            let mut sum = ExactSum::default();
            add_side(&mut sum, origin, direction, a, b);
            sum.value()
        }
    };
    sign(determinant)
}

/// The sign of the volume that three vertices span with the origin.
pub fn volume_sign(origin: Vector, vertices: [Vector; 3]) -> i32 {
    let [a, b, c] = vertices.map(|v| coord(wide(v)));
    sign(orient3d(a, b, c, coord(wide(origin))))
}

fn sign(x: f64) -> i32 {
    i32::from(x > 0.0) - i32::from(x < 0.0)
}

fn wide(v: Vector) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

/// a − b where that is exact in f64.
fn difference(a: Vector, b: Vector) -> Option<DVec3> {
    let (a, b) = (wide(a), wide(b));
    let difference = a - b;
    // Two numbers whose rounded difference gives back both lost nothing.
    (difference + b == a && a - difference == b).then_some(difference)
}

fn coord(v: DVec3) -> Coord3D<f64> {
    Coord3D { x: v.x, y: v.y, z: v.z }
}

#[cfg(test)]
mod tests {
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::tracer::primitives::exact::volume;

    #[test]
    fn the_exact_sum_and_orient3d_agree_on_nearly_degenerate_edges() {
        let mut random = Pcg32::seed_from_u64(9);
        let mut unit = || random.next_u32() as i32 as f32 / i32::MAX as f32;
        let mut signs = [0; 3];
        for i in 0..20_000 {
            let mut vector = || [unit(), unit(), unit()];
            let (origin, a, b) = (vector(), vector(), vector());
            // Towards a point of the edge, exactly in the ray's plane where the sums are exact.
            let share = [0.0, 0.5, 1.0, 0.3][i % 4];
            let direction: Vector = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share - origin[k]);
            let mut sum = ExactSum::default();
            add_side(&mut sum, origin, direction, a, b);
            let exact = sign(sum.value());
            assert_eq!(side(origin, direction, a, b), exact, "{origin:?} {direction:?} {a:?} {b:?}");
            signs[(exact + 1) as usize] += 1;
            let vertices = [a, b, std::array::from_fn(|k| origin[k] + direction[k])];
            assert_eq!(volume_sign(origin, vertices), sign(volume(origin, vertices)), "{origin:?} {vertices:?}");
        }
        assert!(signs.iter().all(|&count| count > 10), "{signs:?}");
    }

    #[test]
    fn what_passes_by_very_little_passes() {
        // The difference of these has more than 53 bits: the plane through them misses the axis by 1e-30.
        let side_of = |x| side([0.5, 0.0, 0.0], [0.0, 0.0, 1.0], [x, 1.0, 0.0], [0.5, -1.0, 1.0]);
        assert_eq!(
            [side_of(0.5 - 1e-7), side_of(0.5), side_of(0.5 + 1e-7)],
            [-side_of(0.5 + 1e-7), 0, side_of(0.5 + 1e-7)]
        );
        assert_eq!(side([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-30, 1.0, 0.5], [-1e-30, -1.0, 0.5]), 0);
        assert_ne!(side([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-30, 1.0, 0.5], [1e-30, -1.0, 0.5]), 0);
    }
}
