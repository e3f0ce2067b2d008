//! Where a wave's rays hit, side by side: the same numbers as [`Hit::surface_point`](crate::tracer::hit::Hit) and the
//! single-ray kernel's shading normal, in lanes.

use glam::DVec3;

use super::packet::{LANES, NONE};
use crate::database::records::{LightTerms, Material, Normals};
use crate::tracer::hit::SurfacePoint;
use crate::tracer::optics::{facing, facing_round, mirrored, rounded, smooth, tint};
use crate::tracer::primitives::triangle::{TriangleHit, point_and_normal};
use crate::tracer::ray::{Ray, Source};
use crate::tracer::shade::Corners;
use crate::tracer::simd::Registers;
use crate::tracer::simd::lanes::Doubles;
use crate::tracer::slices::Slices;
use crate::tracer::vector::{V3, load, select, store};

/// Lanes of doubles.
pub(super) const DOUBLES: usize = 8;

/// Rows of whole chunks of [`LANES`]; what is beyond `count` means nothing.
#[derive(Debug, Default)]
pub(super) struct Surfaces {
    pub count: usize,
    /// Index of the ray in its wave.
    pub ray: Vec<u32>,
    pub primitive: Vec<u32>,
    pub material: Vec<u32>,
    pub source: Vec<Source>,
    pub position: [Vec<f64>; 3],
    /// Where rays to lights leave with a soft terminator; empty with a hard one.
    pub rounded: [Vec<f64>; 3],
    /// Unit geometric normal, outward.
    pub outward: [Vec<f64>; 3],
    /// Unit shading normal, turned to where the ray comes from.
    pub normal: [Vec<f64>; 3],
    /// The ray's direction, reflected; not quite of unit length.
    pub mirrored: [Vec<f64>; 3],
    pub diffuse: [Vec<f32>; 3],
    pub highlight: [Vec<f32>; 3],
    pub shine: Vec<f32>,
    pub radiance: [Vec<f32>; 3],
}

impl Surfaces {
    /// Takes the rays that hit something.
    pub(super) fn take(&mut self, primitives: &[u32], slices: &Slices<'_>, is_terminator_soft: bool) {
        self.ray.clear();
        self.primitive.clear();
        self.material.clear();
        self.source.clear();
        for (ray, &primitive) in primitives.iter().enumerate() {
            if primitive != NONE {
                self.ray.push(ray as u32);
                self.primitive.push(primitive);
                self.material.push(slices.surfaces[primitive as usize].material);
            }
        }
        self.count = self.ray.len();
        let padded = self.count.next_multiple_of(LANES);
        self.source.resize(padded, Source::Eye);
        for rows in [&mut self.position, &mut self.outward, &mut self.normal, &mut self.mirrored] {
            rows.iter_mut().for_each(|row| row.resize(padded, 0.0));
        }
        for rows in [&mut self.diffuse, &mut self.highlight, &mut self.radiance] {
            rows.iter_mut().for_each(|row| row.resize(padded, 0.0));
        }
        if is_terminator_soft {
            self.rounded.iter_mut().for_each(|row| row.resize(padded, 0.0));
        }
        self.radiance.iter_mut().for_each(|row| row.fill(0.0));
        self.shine.resize(padded, 0.0);
        for at in 0..self.count {
            let material = &slices.materials[self.material[at] as usize];
            for channel in 0..3 {
                self.diffuse[channel][at] = material.diffuse[channel];
                self.highlight[channel][at] = material.highlight[channel];
            }
            self.shine[at] = material.shine;
            if material.has_light_terms() {
                let terms = LightTerms::from(slices.materials[self.material[at] as usize + 1]);
                for channel in 0..3 {
                    self.radiance[channel][at] = terms.emission[channel];
                }
            }
        }
    }

    #[inline(always)]
    pub(super) fn material<'a>(&self, slices: &Slices<'a>, at: usize) -> &'a Material {
        &slices.materials[self.material[at] as usize]
    }

    pub(super) fn point(&self, at: usize) -> SurfacePoint {
        SurfacePoint { position: row(&self.position, at), normal: row(&self.outward, at), source: self.source[at] }
    }

    /// Computes positions, normals and mirrored directions.
    #[inline(always)]
    pub(super) fn place<R: Registers>(&mut self, rays: &[Ray], slices: &Slices<'_>) {
        let mut chunk = Chunk::default();
        for first in (0..self.count).step_by(DOUBLES) {
            let lanes = DOUBLES.min(self.count - first);
            let in_triangles = chunk.gather(self, first, lanes, rays, slices);
            let placed = chunk.place::<R::D8>(self, first);
            let mut left = !(in_triangles & placed) & ((1 << lanes) - 1);
            while left != 0 {
                let at = first + left.trailing_zeros() as usize;
                left &= left - 1;
                self.place_one(at, rays, slices);
            }
            chunk.mirror::<R::D8>(self, first);
        }
    }

    /// What lanes leave: spheres, cones, and triangles that f64 cannot decide.
    #[cold]
    #[inline(never)]
    fn place_one(&mut self, at: usize, rays: &[Ray], slices: &Slices<'_>) {
        let ray = &rays[self.ray[at] as usize];
        let Some(hit) = slices.hit(ray, self.primitive[at]) else { unreachable!("what was found to be hit is hit") };
        let point = hit.surface_point(ray);
        let surface = slices.surfaces[self.primitive[at] as usize];
        let Ok(corners) = Corners::read(&mut { *slices }, &hit, surface);
        let normal = corners.normal(&hit, &point);
        let diffuse = corners.tinted(&hit, slices.materials[surface.material as usize].diffuse);
        self.source[at] = point.source;
        for axis in 0..3 {
            self.position[axis][at] = point.position[axis];
            self.outward[axis][at] = point.normal[axis];
            self.normal[axis][at] = normal[axis];
            self.diffuse[axis][at] = diffuse[axis];
        }
        if self.is_round() {
            let seen = facing(point.normal.to_array(), ray.direction_f64().to_array());
            let rounded = corners.rounded(&hit, &point, seen);
            for axis in 0..3 {
                self.rounded[axis][at] = rounded[axis];
            }
        }
    }

    /// Multiplies the diffuse colours of some lanes from `first` on.
    #[inline(always)]
    fn tint<L: Doubles>(&mut self, first: usize, lanes: u32, tint: V3<L>) {
        for (diffuse, tint) in self.diffuse.iter_mut().zip(tint) {
            let mut rounded = [0.0; DOUBLES];
            tint.narrow(&mut rounded);
            for (lane, (diffuse, by)) in diffuse[first..first + DOUBLES].iter_mut().zip(rounded).enumerate() {
                *diffuse *= if lanes >> lane & 1 == 1 { by } else { 1.0 };
            }
        }
    }

    /// Whether the terminator is soft.
    #[inline(always)]
    pub(super) fn is_round(&self) -> bool {
        !self.rounded[0].is_empty()
    }
}

/// What is gathered for [`DOUBLES`] hits.
#[derive(Default)]
struct Chunk {
    /// Coordinates by axis, then vertex.
    corners: [[[f32; DOUBLES]; 3]; 3],
    normals: [[[f32; DOUBLES]; 3]; 3],
    origin: [[f32; DOUBLES]; 3],
    direction: [[f32; DOUBLES]; 3],
    colours: [[[f32; DOUBLES]; 3]; 3],
    /// Lanes whose triangle has vertex normals.
    smooth: u32,
    /// Lanes whose triangle has colours at its corners.
    coloured: u32,
}

impl Chunk {
    /// Gathers what the lanes' rays hit; the lanes that hit triangles.
    #[inline(always)]
    fn gather(
        &mut self,
        surfaces: &mut Surfaces,
        first: usize,
        lanes: usize,
        rays: &[Ray],
        slices: &Slices<'_>,
    ) -> u32 {
        let mut in_triangles = 0;
        self.smooth = 0;
        self.coloured = 0;
        for lane in 0..lanes {
            let ray = &rays[surfaces.ray[first + lane] as usize];
            for axis in 0..3 {
                self.origin[axis][lane] = ray.origin[axis];
                self.direction[axis][lane] = ray.direction[axis];
            }
            let id = surfaces.primitive[first + lane];
            let Some(triangle) = slices.primitives.triangles.get(id as usize) else { continue };
            in_triangles |= 1 << lane;
            surfaces.source[first + lane] = Source::Polygon(triangle.polygon());
            for axis in 0..3 {
                for vertex in 0..3 {
                    self.corners[axis][vertex][lane] = triangle.coordinates[axis][vertex];
                }
            }
            let surface = slices.surfaces[id as usize];
            if let Some(index) = surface.normals() {
                self.smooth |= 1 << lane;
                gather_corners(&slices.normals[index as usize], lane, &mut self.normals);
            }
            if let Some(index) = surface.colours() {
                self.coloured |= 1 << lane;
                gather_corners(&slices.normals[index as usize], lane, &mut self.colours);
            }
        }
        in_triangles
    }

    /// Positions and normals of hits on triangles; the lanes that f64 decides.
    #[inline(always)]
    fn place<L: Doubles>(&self, surfaces: &mut Surfaces, first: usize) -> u32 {
        let (x, y, z) =
            (corners::<L>(&self.corners[0]), corners::<L>(&self.corners[1]), corners::<L>(&self.corners[2]));
        let (origin, direction) = (widen::<L>(&self.origin), widen::<L>(&self.direction));
        let (weights, decided) = TriangleHit::weigh([x, y, z], origin, direction);
        let vertices = [[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]];
        let (position, outward) = point_and_normal(vertices, weights);
        let mut normal = outward;
        let normals = || [widen::<L>(&self.normals[0]), widen::<L>(&self.normals[1]), widen::<L>(&self.normals[2])];
        if self.smooth != 0 {
            normal = select(self.smooth, smooth(normals(), weights, outward), outward);
        }
        if self.coloured & decided != 0 {
            let [a, b, c] = &self.colours;
            let tint = tint([widen::<L>(a), widen::<L>(b), widen::<L>(c)], weights);
            surfaces.tint(first, self.coloured & decided, tint);
        }
        if surfaces.is_round() {
            let mut from = position;
            if self.smooth != 0 {
                let seen = facing(outward, direction);
                from = select(self.smooth, rounded(position, vertices, normals(), weights, seen), position);
            }
            store(from, &mut surfaces.rounded, first);
        }
        store(position, &mut surfaces.position, first);
        store(outward, &mut surfaces.outward, first);
        store(normal, &mut surfaces.normal, first);
        decided
    }

    /// Turns the normals to where the rays come from, and reflects the rays.
    #[inline(always)]
    fn mirror<L: Doubles>(&self, surfaces: &mut Surfaces, first: usize) {
        let incoming = widen::<L>(&self.direction);
        let own = load(&surfaces.normal, first);
        let normal = match surfaces.is_round() {
            true => facing_round(own, load(&surfaces.outward, first), incoming),
            false => facing::<L>(own, incoming),
        };
        store(normal, &mut surfaces.normal, first);
        store(mirrored(incoming, normal), &mut surfaces.mirrored, first);
    }
}

/// The vectors at the corners of a triangle, by corner, then axis.
#[inline(always)]
fn gather_corners(of: &Normals, lane: usize, to: &mut [[[f32; DOUBLES]; 3]; 3]) {
    for (vectors, to) in of.0.iter().zip(to) {
        for (number, to) in vectors.iter().zip(to) {
            to[lane] = *number;
        }
    }
}

/// One vector of many.
#[inline(always)]
pub(super) fn row(rows: &[Vec<f64>; 3], at: usize) -> DVec3 {
    DVec3::new(rows[0][at], rows[1][at], rows[2][at])
}

#[inline(always)]
fn corners<L: Doubles>(rows: &[[f32; DOUBLES]; 3]) -> [L; 3] {
    [L::widen(&rows[0]), L::widen(&rows[1]), L::widen(&rows[2])]
}

#[inline(always)]
fn widen<L: Doubles>(rows: &[[f32; DOUBLES]; 3]) -> V3<L> {
    corners(rows)
}
