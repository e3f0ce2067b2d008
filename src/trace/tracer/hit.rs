//! The nearest hit of a ray, and the point of the surface that it is on.

use glam::DVec3;

use super::memory_port::MemoryPort;
use super::primitives::triangle::point_and_normal;
use super::primitives::{cone, sphere};
use super::ray::{Ray, Source};
use crate::database::primitives::PrimitiveIndex;
use crate::database::records::{Cone, PrimitiveId, Sphere, Triangle};

/// A hit: the minimum over all primitives of (t, id), whatever the octree.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Along the ray's direction, normalised units.
    pub t: f32,
    pub primitive: PrimitiveId,
    pub on: HitOn,
}

/// The primitive as it was read, and where on it the hit is.
#[derive(Clone, Copy, Debug)]
pub enum HitOn {
    Triangle {
        triangle: Triangle,
        /// Weights of the vertices; they sum to 1.
        barycentrics: [f64; 3],
    },
    Sphere {
        sphere: Sphere,
        t: f64,
    },
    Cone {
        cone: Cone,
        t: f64,
    },
}

impl HitOn {
    /// Where a ray hits the sphere or cone at this index, whatever the distance, and `t` there.
    ///
    /// # Errors
    /// The port's.
    #[inline(always)]
    pub fn curved<M: MemoryPort>(
        port: &mut M,
        ray: &Ray,
        primitive: PrimitiveId,
        index: PrimitiveIndex,
    ) -> Result<Option<(f64, Self)>, M::Error> {
        let leaving = ray.source == Source::Curved(primitive.0);
        Ok(match index {
            PrimitiveIndex::Triangle(_) => None,
            PrimitiveIndex::Sphere(index) => {
                let sphere = port.sphere(index)?;
                sphere::intersect(ray, &sphere, leaving).map(|t| (t, Self::Sphere { sphere, t }))
            }
            PrimitiveIndex::Cone(index) => {
                let cone = port.cone(index)?;
                cone::intersect(ray, &cone, leaving).map(|t| (t, Self::Cone { cone, t }))
            }
        })
    }
}

/// A point on a surface, normalised coordinates.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    pub position: DVec3,
    /// Unit, outward: by the winding of a polygon, away from the inside of a sphere or cone.
    pub normal: DVec3,
    pub source: Source,
}

impl SurfacePoint {
    /// A ray from here along a unit direction, moved off to the side that it leaves to.
    pub fn leaving(&self, direction: DVec3, t_max: f32) -> Ray {
        Ray::leaving(self.position, self.normal, direction, t_max, self.source)
    }

    /// The normal turned to where a ray along `direction` comes from.
    pub fn normal_to_eye(&self, direction: DVec3) -> [f32; 3] {
        let normal = if self.normal.dot(direction) > 0.0 { -self.normal } else { self.normal };
        normal.as_vec3().to_array()
    }
}

impl Hit {
    /// Where the hit is, in f64: from barycentrics, or on the sphere's or cone's own surface.
    pub fn surface_point(&self, ray: &Ray) -> SurfacePoint {
        let along = |t: f64| ray.origin_f64() + ray.direction_f64() * t;
        match &self.on {
            HitOn::Triangle { triangle, barycentrics } => {
                let vertices = triangle.vertices().map(|vertex| vertex.to_array());
                let (position, normal) = point_and_normal(vertices, *barycentrics);
                let source = Source::Polygon(triangle.polygon());
                SurfacePoint { position: position.into(), normal: normal.into(), source }
            }
            HitOn::Sphere { sphere, t } => {
                let centre = DVec3::from(sphere.centre.map(f64::from));
                let normal = (along(*t) - centre).normalize_or_zero();
                SurfacePoint {
                    position: centre + normal * f64::from(sphere.radius.abs()),
                    normal,
                    source: Source::Curved(self.primitive.0),
                }
            }
            HitOn::Cone { cone, t } => {
                let position = along(*t);
                SurfacePoint {
                    position,
                    normal: cone::normal(cone, position),
                    source: Source::Curved(self.primitive.0),
                }
            }
        }
    }
}
