//! Rays to ask tracer and oracle with: those that images are made of, and those that hurt.

use glam::DVec3;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use serde::Serialize;

use crate::database::primitives::{Primitive, Primitives};
use crate::database::records::PrimitiveId;
use crate::database::verify::Verified;
use crate::tracer::View;
use crate::tracer::primary::PrimaryRays;
use crate::tracer::ray::{Ray, Source};

/// What rays are aimed at.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AimedAt {
    /// The centre of a pixel, from the eye.
    Pixel,
    /// Anything, from anywhere in the root or from outside of it.
    Anywhere,
    /// Along one axis or in a plane of two, often exactly through a vertex.
    AlongAxes,
    /// A point of an edge or a vertex; for a scene without triangles, a point of a sphere's or cone's box.
    Edge,
    /// Away from a surface that another ray hit.
    FromSurface,
}

impl AimedAt {
    pub const COUNT: usize = 5;
    pub const ALL: [Self; Self::COUNT] = [Self::Pixel, Self::Anywhere, Self::AlongAxes, Self::Edge, Self::FromSurface];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Pixel => "pixels",
            Self::Anywhere => "anywhere",
            Self::AlongAxes => "along axes",
            Self::Edge => "edges",
            Self::FromSurface => "surfaces",
        }
    }
}

/// A source of rays; the same seed gives the same rays.
pub struct Rays<'a> {
    random: Pcg32,
    camera: PrimaryRays,
    pixels: (u32, u32),
    primitives: Primitives<'a>,
}

impl<'a> Rays<'a> {
    pub fn new(verified: &'a Verified, view: &View, seed: u64) -> Self {
        let database = verified.database();
        Self {
            random: Pcg32::seed_from_u64(seed),
            camera: PrimaryRays::new(&database.header, view),
            pixels: (view.image.width(), view.image.height()),
            primitives: Primitives::of(verified),
        }
    }

    /// Through a random pixel; `None` if it misses the root.
    pub fn through_pixel(&mut self) -> Option<Ray> {
        let (x, y) = (self.below(self.pixels.0), self.below(self.pixels.1));
        Ray::from_eye(self.camera.eye, self.camera.direction(x, y)).map(|(ray, _)| ray)
    }

    pub fn anywhere(&mut self) -> Ray {
        let (origin, target) = (self.point(), self.point());
        if self.below(2) == 0 {
            return ray(origin, (target - origin).normalize_or(DVec3::X));
        }
        let outside = self.direction() * 4.0;
        let from_outside = Ray::from_eye(outside, (target - outside).normalize());
        from_outside.map_or_else(|| ray(origin, self.direction()), |(ray, _)| ray)
    }

    pub fn along_axes(&mut self) -> Ray {
        let axis = self.below(3) as usize;
        let mut direction = DVec3::ZERO;
        direction[axis] = if self.below(2) == 0 { 1.0 } else { -1.0 };
        if self.below(3) == 0 {
            direction[(axis + 1) % 3] = self.unit();
        }
        let (target, anywhere) = (self.vertex(), self.point());
        let mut origin = if self.below(4) == 0 { anywhere } else { target };
        // Back to the root's face, or to anywhere on the way.
        origin[axis] = if self.below(2) == 0 { -direction[axis] } else { anywhere[axis] };
        ray(origin, direction.normalize())
    }

    pub fn at_edge(&mut self) -> Ray {
        let (from, to) = if self.primitives.triangles.is_empty() {
            (self.vertex(), self.vertex())
        } else {
            let which = self.below(self.primitives.triangles.len() as u32) as usize;
            let vertices = self.primitives.triangles[which].vertices();
            let first = self.below(3) as usize;
            (vertices[first], vertices[(first + 1) % 3])
        };
        let share = [0.0, 0.5, f64::from(self.random.next_u32()) / f64::from(u32::MAX)][self.below(3) as usize];
        let origin = self.point();
        ray(origin, (from + (to - from) * share - origin).normalize_or(DVec3::X))
    }

    /// A random unit direction.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let point = self.point();
            let length = point.length();
            if length > 0.01 && length <= 1.0 {
                return point / length;
            }
        }
    }

    /// A vertex, or a corner of a sphere's or cone's box.
    fn vertex(&mut self) -> DVec3 {
        let count = self.primitives.count() as u32;
        if count == 0 {
            return self.point();
        }
        let id = PrimitiveId(self.below(count));
        let (centre, radius) = match self.primitives.get(id) {
            Some(Primitive::Triangle(triangle)) => {
                let corner = self.below(3) as usize;
                return triangle.vertices()[corner];
            }
            Some(Primitive::Sphere(sphere)) => (sphere.centre, sphere.radius),
            Some(Primitive::Cone(cone)) => (cone.base, cone.base_radius),
            None => unreachable!("below their count"),
        };
        let corner = DVec3::from(centre.map(f64::from)) + self.point() * f64::from(radius);
        corner.clamp(DVec3::NEG_ONE, DVec3::ONE)
    }

    /// Anywhere in the root.
    fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// −1 to 1.
    fn unit(&mut self) -> f64 {
        f64::from(self.random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    /// 0 to `end` − 1; the bias of the remainder does not matter here.
    fn below(&mut self, end: u32) -> u32 {
        self.random.next_u32() % end
    }
}

fn ray(origin: DVec3, direction: DVec3) -> Ray {
    Ray {
        origin: origin.as_vec3().to_array(),
        direction: direction.as_vec3().to_array(),
        t_max: f32::INFINITY,
        source: Source::Eye,
    }
}
