//! Boxes around primitives, fitted to them.

use crate::database::primitives::Primitives;
use crate::database::records::Triangle;
use crate::database::verify::Verified;
use crate::tracer::octree::overlap::{Bounds, PADDING};

#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    pub(super) lo: [f32; 3],
    pub(super) hi: [f32; 3],
}

impl Fitted {
    pub(super) const EMPTY: Self = Self { lo: [f32::INFINITY; 3], hi: [f32::NEG_INFINITY; 3] };

    pub(super) fn union(self, other: Self) -> Self {
        Self {
            lo: std::array::from_fn(|a| self.lo[a].min(other.lo[a])),
            hi: std::array::from_fn(|a| self.hi[a].max(other.hi[a])),
        }
    }

    pub(super) fn centre(&self) -> [f32; 3] {
        std::array::from_fn(|a| 0.5 * (self.lo[a] + self.hi[a]))
    }

    /// Half of the surface.
    pub(super) fn area(&self) -> f32 {
        let [x, y, z] = std::array::from_fn(|a| self.hi[a] - self.lo[a]);
        x * y + y * z + z * x
    }
}

/// The boxes of a database's primitives.
pub(super) struct Boxes<'a> {
    pub(super) triangles: &'a [Triangle],
    /// Of spheres, then cones.
    curved: Vec<Bounds>,
}

impl<'a> Boxes<'a> {
    pub(super) fn new(database: &'a Verified) -> Self {
        let Primitives { triangles, spheres, cones } = Primitives::of(database);
        let curved = spheres.iter().map(Bounds::of_sphere).chain(cones.iter().map(Bounds::of_cone)).collect();
        Self { triangles, curved }
    }

    pub(super) fn count(&self) -> usize {
        self.triangles.len() + self.curved.len()
    }

    /// Whether there are triangles and others.
    pub(super) fn are_of_kinds(&self) -> bool {
        !self.triangles.is_empty() && !self.curved.is_empty()
    }

    /// The box of a primitive.
    pub(super) fn of(&self, id: u32) -> Fitted {
        match self.triangles.get(id as usize) {
            Some(triangle) => {
                let [x, y, z] = &triangle.coordinates;
                let least = |c: &[f32; 3]| c[0].min(c[1]).min(c[2]);
                let most = |c: &[f32; 3]| c[0].max(c[1]).max(c[2]);
                Fitted { lo: [least(x), least(y), least(z)], hi: [most(x), most(y), most(z)] }
            }
            None => {
                let bounds = &self.curved[id as usize - self.triangles.len()];
                Fitted {
                    lo: std::array::from_fn(|a| (bounds.lo[a] - PADDING) as f32),
                    hi: std::array::from_fn(|a| (bounds.hi[a] + PADDING) as f32),
                }
            }
        }
    }
}
