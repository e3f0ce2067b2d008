//! Which of a cell's eight children each of its primitives reaches into, with the vector instructions that
//! the processor has: the same decisions with all of them, since nothing is fused or reordered.

use super::overlap::{Bounds, Cell, cone_octants, sphere_octants, triangle_octants};
use crate::database::compile::Records;
use crate::database::primitives::{Primitive, Primitives};
use crate::database::records::PrimitiveId;
use crate::tracer::simd::{Registers, Simd, Task};

/// Asks the primitives of a database.
#[derive(Clone, Copy, Debug)]
pub(super) struct Octants<'a> {
    records: &'a Records,
    simd: Simd,
}

impl<'a> Octants<'a> {
    pub(super) fn new(records: &'a Records) -> Self {
        Self { records, simd: Simd::best() }
    }

    /// For each of `ids`, which reach into the cell: bit o is set if it reaches into octant o.
    pub(super) fn of(&self, ids: &[u32], cell: Cell, octants: &mut Vec<u8>) {
        self.simd.run(All { records: self.records, ids, cell, octants });
    }
}

struct All<'t> {
    records: &'t Records,
    ids: &'t [u32],
    cell: Cell,
    octants: &'t mut Vec<u8>,
}

impl Task for All<'_> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(self) {
        of_all(self.records, self.ids, self.cell, self.octants);
    }
}

#[inline(always)]
fn of_all(records: &Records, ids: &[u32], cell: Cell, octants: &mut Vec<u8>) {
    let primitives = records.primitives();
    // The boxes first, in a loop without a branch that depends on what it loads.
    octants.clear();
    octants.resize(ids.len(), 0);
    for (&id, octants) in ids.iter().zip(&mut *octants) {
        *octants = match primitives.triangles.get(id as usize) {
            Some(triangle) => Bounds::of_triangle(triangle).octants(cell),
            None => curved_bounds(primitives, id).octants(cell),
        };
    }
    for (&id, octants) in ids.iter().zip(octants) {
        // In one octant only: it is that one, since the primitive reaches into the cell.
        if octants.count_ones() <= 1 {
            continue;
        }
        *octants = match primitives.get(PrimitiveId(id)) {
            // In two, on either side of a plane, and nowhere outside of the cell: a vertex is in each.
            Some(Primitive::Triangle(triangle))
                if octants.count_ones() == 2 && Bounds::of_triangle(triangle).is_within(cell) =>
            {
                continue;
            }
            Some(Primitive::Triangle(triangle)) => triangle_octants(triangle, cell, *octants),
            Some(Primitive::Sphere(sphere)) => sphere_octants(sphere, cell, *octants),
            Some(Primitive::Cone(cone)) => cone_octants(cone, cell, *octants),
            None => unreachable!("a cell lists primitives of its records"),
        };
    }
}

#[inline(never)]
fn curved_bounds(primitives: Primitives<'_>, id: u32) -> Bounds {
    match primitives.get(PrimitiveId(id)) {
        Some(Primitive::Triangle(triangle)) => Bounds::of_triangle(triangle),
        Some(Primitive::Sphere(sphere)) => Bounds::of_sphere(sphere),
        Some(Primitive::Cone(cone)) => Bounds::of_cone(cone),
        None => unreachable!("a cell lists primitives of its records"),
    }
}
