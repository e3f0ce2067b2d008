//! From world coordinates to the root cube, in f64.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// `normalised = (world − centre) · scale`. The root cube is `[−1, 1]³`; the scene fits inside it with a
/// margin, so that no surface lies in the root's faces.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Normalisation {
    pub centre: DVec3,
    /// Normalised units a world unit, positive.
    pub scale: f64,
}

impl Normalisation {
    /// Share of the root's half extent that the scene fills.
    const FILL: f64 = 1.0 - 1.0 / 4096.0;

    /// What rounding may move a point away from the centre, as a share of its largest coordinate: 2⁻⁵³ each for
    /// the centre, the half extent, a sphere's bounds and the difference, doubled.
    const ROUNDING: f64 = 1.0 / (1u64 << 50) as f64;

    /// For a scene with these bounds; an empty scene or a single point has scale 1.
    pub fn new(bounds: Option<(DVec3, DVec3)>) -> Self {
        let Some((lo, hi)) = bounds else {
            return Self { centre: DVec3::ZERO, scale: 1.0 };
        };
        // Halved first: the sum or difference of two large coordinates may overflow.
        let centre = lo * 0.5 + hi * 0.5;
        let half = (hi * 0.5 - lo * 0.5).max_element();
        // A scene far from the origin may be only some thousand units in the last place wide: then rounding takes
        // up the margin, and the half extent has to cover it too.
        let rounding = lo.abs().max(hi.abs()).max_element() * Self::ROUNDING;
        let margin = half * (1.0 - Self::FILL);
        let half = if half > 0.0 && rounding > margin / 2.0 { half + rounding } else { half };
        let scale = Self::FILL / half;
        Self { centre, scale: if scale.is_finite() && scale > 0.0 { scale } else { 1.0 } }
    }

    pub fn point(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    /// Normalised length of a world length.
    pub fn length(&self, world: f64) -> f64 {
        world * self.scale
    }

    /// World length of a normalised length.
    pub fn world_length(&self, normalised: f64) -> f64 {
        normalised / self.scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners(lo: DVec3, hi: DVec3) -> impl Iterator<Item = DVec3> {
        (0..8).map(move |i| DVec3::from_array(std::array::from_fn(|a| if i >> a & 1 == 0 { lo[a] } else { hi[a] })))
    }

    #[test]
    fn what_is_some_units_in_the_last_place_wide_fits_into_the_root() {
        for offset in [1e9f64, -1e9, 12_345_678.9, 1e300] {
            for width in (0..40).map(|k| offset.abs() * f64::EPSILON * 1.5f64.powi(k)) {
                let lo = DVec3::new(offset, offset / 3.0, 0.0);
                let hi = lo + width;
                let normalisation = Normalisation::new(Some((lo, hi)));
                for corner in corners(lo, hi) {
                    let farthest = normalisation.point(corner).abs().max_element();
                    assert!(farthest < 1.0, "{farthest} for {width} at {offset}");
                }
            }
        }
    }

    #[test]
    fn an_ordinary_scene_fills_the_root_but_for_the_margin() {
        for (lo, hi) in [(-1.0, 1.0), (0.0, 1e-12), (1e6, 1e6 + 1.0), (-1e12, 1e12), (1e9, 1e9 + 1.0), (-1e308, 1e308)]
        {
            let (lo, hi) = (DVec3::splat(lo), DVec3::new(hi, lo, lo));
            let scale = Normalisation::new(Some((lo, hi))).scale;
            assert_eq!(scale, Normalisation::FILL / (hi.x * 0.5 - lo.x * 0.5), "{lo} {hi}");
        }
        let point = Normalisation::new(Some((DVec3::splat(1e9), DVec3::splat(1e9))));
        assert_eq!((point.scale, point.point(DVec3::splat(1e9))), (1.0, DVec3::ZERO));
    }
}
