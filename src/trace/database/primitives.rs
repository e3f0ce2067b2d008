//! Which primitive an id is. Triangles have the first ids, then spheres, then cones.

use super::records::{Cone, PrimitiveId, Sphere, Triangle};
use super::verify::Verified;
use super::{Layout, Section};

/// A primitive's kind, and its index among those of that kind.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PrimitiveIndex {
    Triangle(u32),
    Sphere(u32),
    Cone(u32),
}

/// How many primitives of each kind there are.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct PrimitiveCounts {
    pub triangles: u32,
    pub spheres: u32,
    pub cones: u32,
}

impl PrimitiveCounts {
    pub fn of(layout: &Layout) -> Self {
        // An image has fewer than 2³² records.
        let count = |section| layout.span(section).records as u32;
        Self { triangles: count(Section::Triangles), spheres: count(Section::Spheres), cones: count(Section::Cones) }
    }

    /// Where a primitive is; `None` if there is no such primitive.
    #[inline(always)]
    pub fn locate(self, id: PrimitiveId) -> Option<PrimitiveIndex> {
        let Some(curved) = id.0.checked_sub(self.triangles) else { return Some(PrimitiveIndex::Triangle(id.0)) };
        let Some(cone) = curved.checked_sub(self.spheres) else { return Some(PrimitiveIndex::Sphere(curved)) };
        (cone < self.cones).then_some(PrimitiveIndex::Cone(cone))
    }
}

/// A primitive's record.
#[derive(Clone, Copy, Debug)]
pub enum Primitive<'a> {
    Triangle(&'a Triangle),
    Sphere(&'a Sphere),
    Cone(&'a Cone),
}

/// The records of all primitives.
#[derive(Clone, Copy, Debug)]
pub struct Primitives<'a> {
    pub triangles: &'a [Triangle],
    pub spheres: &'a [Sphere],
    pub cones: &'a [Cone],
}

impl<'a> Primitives<'a> {
    pub fn of(verified: &'a Verified) -> Self {
        let database = verified.unpadded();
        Self {
            triangles: database.records(Section::Triangles),
            spheres: database.records(Section::Spheres),
            cones: database.records(Section::Cones),
        }
    }

    #[inline(always)]
    pub fn counts(self) -> PrimitiveCounts {
        let Self { triangles, spheres, cones } = self;
        PrimitiveCounts { triangles: triangles.len() as u32, spheres: spheres.len() as u32, cones: cones.len() as u32 }
    }

    pub fn count(self) -> usize {
        self.triangles.len() + self.spheres.len() + self.cones.len()
    }

    /// `None` if the primitive is no sphere. A comparison less than [`Self::get`].
    #[inline(always)]
    pub fn sphere(self, id: PrimitiveId) -> Option<&'a Sphere> {
        // Of a triangle the index wraps, and is too large.
        self.spheres.get((id.0 as usize).wrapping_sub(self.triangles.len()))
    }

    /// `None` if there is no such primitive.
    #[inline(always)]
    pub fn get(self, id: PrimitiveId) -> Option<Primitive<'a>> {
        Some(match self.counts().locate(id)? {
            PrimitiveIndex::Triangle(index) => Primitive::Triangle(&self.triangles[index as usize]),
            PrimitiveIndex::Sphere(index) => Primitive::Sphere(&self.spheres[index as usize]),
            PrimitiveIndex::Cone(index) => Primitive::Cone(&self.cones[index as usize]),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_go_on_from_kind_to_kind() {
        let counts = PrimitiveCounts { triangles: 2, spheres: 1, cones: 2 };
        let located: Vec<_> = (0..6).map(|id| counts.locate(PrimitiveId(id))).collect();
        use PrimitiveIndex::{Cone, Sphere, Triangle};
        let expected = [Some(Triangle(0)), Some(Triangle(1)), Some(Sphere(0)), Some(Cone(0)), Some(Cone(1)), None];
        assert_eq!(located, expected);
        assert_eq!(counts.locate(PrimitiveId(u32::MAX)), None);
        assert_eq!(PrimitiveCounts::default().locate(PrimitiveId(0)), None);
        let spheres = PrimitiveCounts { spheres: u32::MAX, ..PrimitiveCounts::default() };
        assert_eq!(spheres.locate(PrimitiveId(u32::MAX - 1)), Some(Sphere(u32::MAX - 1)));
    }
}
