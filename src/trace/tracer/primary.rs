//! Primary rays: from the eye through the centres of pixels, in f64.

use glam::DVec3;

use super::hit::SurfacePoint;
use super::simd::lanes::Doubles;
use super::vector::{V3, add, normalise, scale, splat};
use super::view::View;
use crate::database::{Header, Normalisation};

/// A pinhole camera: `d + (2(x+½)/W − 1)·tan(angle/2)·W/H·r + (1 − 2(y+½)/H)·tan(angle/2)·u`, row 0 on top.
pub struct PrimaryRays {
    /// Normalised coordinates.
    pub eye: DVec3,
    forward: DVec3,
    /// Half the width and height of the image plane at distance 1, as vectors.
    right: DVec3,
    up: DVec3,
    /// A pixel's width and height, where the image's are 2.
    step: [f64; 2],
    normalisation: Normalisation,
}

impl PrimaryRays {
    pub fn new(header: &Header, view: &View) -> Self {
        let camera = &view.camera;
        let forward = (camera.at - camera.from).normalize();
        let right = forward.cross(camera.up).normalize();
        let (width, height) = (f64::from(view.image.width()), f64::from(view.image.height()));
        let half_height = libm::tan(camera.angle_degrees.to_radians() / 2.0);
        Self {
            eye: header.normalisation.point(camera.from),
            forward,
            right: right * (half_height * width / height),
            up: right.cross(forward) * half_height,
            step: [2.0 / width, 2.0 / height],
            normalisation: header.normalisation,
        }
    }

    /// Unit direction through the centre of a pixel.
    pub fn direction(&self, x: u32, y: u32) -> DVec3 {
        self.directions(f64::from(x), f64::from(y)).into()
    }

    /// Unit directions through the centres of pixels.
    #[inline(always)]
    pub fn directions<L: Doubles>(&self, x: L, y: L) -> V3<L> {
        let (one, half) = (L::splat(1.0), L::splat(0.5));
        let across = x.add(half).mul(L::splat(self.step[0])).sub(one);
        let upward = one.sub(y.add(half).mul(L::splat(self.step[1])));
        let right = scale(splat(self.right.to_array()), across);
        let up = scale(splat(self.up.to_array()), upward);
        normalise(add(add(splat(self.forward.to_array()), right), up))
    }

    /// Distance of a point along its pixel's direction, world units.
    pub fn depth(&self, point: &SurfacePoint, direction: DVec3) -> f32 {
        self.normalisation.world_length((point.position - self.eye).dot(direction)) as f32
    }
}
