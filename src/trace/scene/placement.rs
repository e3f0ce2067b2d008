//! A scene elsewhere and of another size: the same picture, other numbers.

use serde::Serialize;

use super::Scene;

/// `world = world · scale + translation`, the same on every axis.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub struct Placement {
    /// Positive.
    pub scale: f64,
    /// World units.
    pub translation: f64,
}

/// A coordinate or radius would no longer be finite, or a radius no longer differ from zero.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
#[error("the scene cannot be scaled by {:e} and moved by {:e}: its numbers overflow or vanish", .0.scale, .0.translation)]
pub struct Unplaceable(pub Placement);

impl Scene {
    /// Scales and moves everything: surfaces, camera, lights.
    ///
    /// # Errors
    /// The scene's numbers leave the range of f64. The scene is of no use then.
    pub fn place(&mut self, placement: Placement) -> Result<(), Unplaceable> {
        let Placement { scale, translation } = placement;
        let mut sound = true;
        let mut length = |x: f64| {
            let scaled = x * scale;
            sound &= scaled.is_finite() && (x == 0.0 || scaled != 0.0);
            scaled
        };
        for sphere in &mut self.spheres {
            sphere.radius = length(sphere.radius);
        }
        for cone in &mut self.cones {
            (cone.base_radius, cone.apex_radius) = (length(cone.base_radius), length(cone.apex_radius));
        }
        let points = (self.vertices.iter_mut())
            .chain(self.spheres.iter_mut().map(|s| &mut s.centre))
            .chain(self.cones.iter_mut().flat_map(|c| [&mut c.base, &mut c.apex]))
            .chain(self.lights.iter_mut().map(|l| &mut l.position))
            .chain(self.camera.iter_mut().flat_map(|c| [&mut c.from, &mut c.at]));
        for point in points {
            *point = *point * scale + translation;
            sound &= point.is_finite();
        }
        if sound { Ok(()) } else { Err(Unplaceable(placement)) }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::scene::{Camera, Sphere, UpAxis};

    #[test]
    fn surfaces_and_camera_move_together() {
        let camera = Camera::framing(Some((DVec3::ZERO, DVec3::ONE)), UpAxis::Y, 1.0, 45.0);
        let sphere = Sphere { centre: DVec3::X, radius: -2.0, material: 0 };
        let mut scene = Scene { camera: Some(camera), spheres: vec![sphere], ..Scene::default() };
        scene.place(Placement { scale: 10.0, translation: 5.0 }).expect("finite");
        assert_eq!(scene.spheres, [Sphere { centre: DVec3::new(15.0, 5.0, 5.0), radius: -20.0, material: 0 }]);
        assert_eq!(scene.camera.map(|c| c.from), Some(camera.from * 10.0 + 5.0));
        assert!(scene.place(Placement { scale: 1e308, translation: 0.0 }).is_err());
    }
}
