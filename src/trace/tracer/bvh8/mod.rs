//! The fast kernel: an eight-wide bounding volume hierarchy, built by a process that has the whole database, and packets of
//! rays traced through it. Its hits are those of the single-ray kernel, bit by bit: lanes decide what is sure, the
//! single-ray kernel's own functions decide the rest.
//!
//! What is studied, counted and recorded is HERO's octree alone. This hierarchy is there to be fast; it has from I. Wald et al.,
//! *Interactive Rendering with Coherent Ray Tracing*, 2001, the packets, and what `build` names.

mod batch;
mod branching;
mod build;
mod decide;
mod fitted;
mod lighting;
mod packet;
mod primaries;
mod surfaces;
mod tree;
mod triangles;
mod walk;
mod wave;

pub use batch::BatchTracer;
pub use tree::Bvh8;
pub use walk::Visits;

use packet::{LANES, Packet};
use walk::Scratch;

use super::hit::Hit;
use super::octree::hero::Hero;
use super::ray::Ray;
use super::simd::{Registers, Simd, Task};
use super::slices::Slices;
use super::stats::TraceStats;
use crate::database::verify::Verified;

/// Traces batches of rays.
pub struct PacketTracer<'a> {
    bvh: &'a Bvh8,
    slices: Slices<'a>,
    simd: Simd,
    packet: Box<Packet>,
    scratch: Scratch,
    queues: Queues,
    /// For rays that packets are not made for.
    hero: Hero,
}

impl<'a> PacketTracer<'a> {
    pub fn new(bvh: &'a Bvh8, database: &'a Verified, simd: Simd) -> Self {
        Self {
            bvh,
            slices: Slices::new(database),
            simd,
            packet: Box::new(Packet::new()),
            scratch: Scratch::new(),
            queues: Queues::default(),
            hero: Hero::new(&database.database().header, true),
        }
    }

    pub fn counts(&self) -> Visits {
        self.scratch.counts
    }

    /// The nearest hit of each ray: the minimum of (t, id) over all primitives.
    pub fn nearest(&mut self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let mut queues = std::mem::take(&mut self.queues);
        queues.sort(rays);
        let mut primitives = vec![packet::NONE; rays.len()];
        self.nearest_primitives(rays, &queues, &mut primitives);
        self.queues = queues;
        let hit = |(ray, &id): (&Ray, &u32)| if id == packet::NONE { None } else { self.slices.hit(ray, id) };
        rays.iter().zip(&primitives).map(hit).collect()
    }

    /// Whether anything is hit before each ray's `t_max`.
    pub fn occluded(&mut self, rays: &[Ray]) -> Vec<bool> {
        let mut queues = std::mem::take(&mut self.queues);
        queues.sort(rays);
        let mut occluded = vec![true; rays.len()];
        let done = |index: usize, packet: &Packet, lane: usize| occluded[index] = packet.active >> lane & 1 == 0;
        self.simd.run(WalkAll::<true, _> { tracer: self, rays, queues: &queues, done });
        for &index in &queues.unusual {
            let ray = &rays[index as usize];
            let Ok(hit) = self.hero.occluded(&mut self.slices, ray, &mut TraceStats::default());
            occluded[index as usize] = hit;
        }
        self.queues = queues;
        occluded
    }

    /// The id of the primitive that each ray hits first, [`packet::NONE`] where there is none.
    fn nearest_primitives(&mut self, rays: &[Ray], queues: &Queues, primitives: &mut [u32]) {
        let done = |index: usize, packet: &Packet, lane: usize| primitives[index] = packet.primitive[lane].to_bits();
        self.simd.run(WalkAll::<false, _> { tracer: self, rays, queues, done });
        for &index in &queues.unusual {
            let ray = &rays[index as usize];
            let Ok(hit) = self.hero.nearest(&mut self.slices, ray, &mut TraceStats::default());
            primitives[index as usize] = hit.map_or(packet::NONE, |hit| hit.primitive.0);
        }
    }
}

/// Indices of rays, sorted into what packets are made of.
#[derive(Debug, Default)]
struct Queues {
    by_octant: [Vec<u32>; 8],
    /// Rays that packets are not made for.
    unusual: Vec<u32>,
}

impl Queues {
    fn clear(&mut self) {
        self.by_octant.iter_mut().for_each(Vec::clear);
        self.unusual.clear();
    }

    #[inline(always)]
    fn push(&mut self, ray: &Ray, index: u32) {
        match Packet::octant(ray) {
            Some(octant) => self.by_octant[octant].push(index),
            None => self.unusual.push(index),
        }
    }

    fn sort(&mut self, rays: &[Ray]) {
        self.clear();
        rays.iter().enumerate().for_each(|(index, ray)| self.push(ray, index as u32));
    }
}

/// Walks packets of queued rays, and tells of each ray's index and lane when its packet is done.
struct WalkAll<'t, 'a, 'r, const ANY: bool, Done> {
    tracer: &'t mut PacketTracer<'a>,
    rays: &'r [Ray],
    queues: &'r Queues,
    done: Done,
}

impl<const ANY: bool, Done: FnMut(usize, &Packet, usize)> Task for WalkAll<'_, '_, '_, ANY, Done> {
    type Output = ();

    #[inline(always)]
    fn run<R: Registers>(mut self) {
        let PacketTracer { bvh, slices, packet, scratch, .. } = self.tracer;
        for queue in &self.queues.by_octant {
            for indices in queue.chunks(LANES) {
                packet.fill::<R>(self.rays, indices);
                walk::walk::<R, ANY>(bvh, slices, packet, scratch);
                for (lane, &index) in indices.iter().enumerate() {
                    (self.done)(index as usize, packet, lane);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::tracer::octree::{BuildParameters, build_database};
    use crate::tracer::ray::Source;

    fn vector(random: &mut Pcg32) -> DVec3 {
        let mut unit = || f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0;
        DVec3::new(unit(), unit(), unit())
    }

    fn rays(random: &mut Pcg32, count: usize) -> Vec<Ray> {
        let one = |i: usize| {
            // Sixteen at a time run nearly alike.
            let mut group = Pcg32::seed_from_u64(i as u64 / 16);
            let spread = [1e-3, 0.05, 1.0][i / 16 % 3];
            let mut origin = vector(&mut group) * 0.9 + vector(random) * 0.1 * spread;
            let mut direction = vector(&mut group) + vector(random) * spread;
            if i.is_multiple_of(5) {
                direction[i % 3] = 0.0;
                origin[i % 3] = 0.25;
            }
            Ray {
                origin: origin.as_vec3().to_array(),
                direction: direction.normalize().as_vec3().to_array(),
                t_max: if i.is_multiple_of(4) { 0.5 } else { f32::INFINITY },
                source: Source::Eye,
            }
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn hits_are_those_of_the_single_ray_kernel_with_any_instructions() {
        let mut random = Pcg32::seed_from_u64(7);
        for scene in ["teapot:6", "gears:1", "balls:2", "tetra:4"] {
            let scene = scene.parse::<crate::scene::SceneSource>().expect("a scene");
            let scene = scene.load().expect("procedural");
            for (leaf_size, max_depth) in [(8, 12), (1, 6), (40, 3)] {
                let database = build_database(&scene, BuildParameters { leaf_size, max_depth }).expect("builds");
                let bvh = Bvh8::build(&database);
                let rays = rays(&mut random, 4000);
                let mut port = Slices::new(&database);
                let mut hero = Hero::new(&database.database().header, true);
                let expected: Vec<_> = rays
                    .iter()
                    .map(|ray| {
                        let Ok(hit) = hero.nearest(&mut port, ray, &mut TraceStats::default());
                        hit.map(|hit| (hit.t, hit.primitive.0))
                    })
                    .collect();
                for simd in Simd::available() {
                    let mut tracer = PacketTracer::new(&bvh, &database, simd);
                    let found = tracer.nearest(&rays);
                    let found: Vec<_> = found.iter().map(|hit| hit.map(|hit| (hit.t, hit.primitive.0))).collect();
                    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
                        assert_eq!(found, expected, "ray {i} {:?}, {simd}", rays[i]);
                    }
                    let occluded = tracer.occluded(&rays);
                    for (i, (occluded, expected)) in occluded.iter().zip(&expected).enumerate() {
                        assert_eq!(*occluded, expected.is_some(), "shadow ray {i} {:?}, {simd}", rays[i]);
                    }
                }
                assert!(expected.iter().flatten().count() > 500, "{}", expected.iter().flatten().count());
            }
        }
    }

    #[test]
    fn leaves_can_be_replaced_one_by_one() {
        let scene = "balls:2".parse::<crate::scene::SceneSource>().expect("a scene");
        let mut scene = scene.load().expect("procedural");
        let teapot = "teapot:4".parse::<crate::scene::SceneSource>().expect("a scene");
        let teapot = teapot.load().expect("procedural");
        (scene.polygons, scene.vertices, scene.normals) = (teapot.polygons, teapot.vertices, teapot.normals);
        scene.materials.extend(teapot.materials);
        let database = build_database(&scene, BuildParameters { leaf_size: 8, max_depth: 12 }).expect("builds");
        let rays = rays(&mut Pcg32::seed_from_u64(3), 3000);
        let hits = |bvh: &Bvh8| -> Vec<_> {
            let found = PacketTracer::new(bvh, &database, Simd::best()).nearest(&rays);
            found.iter().map(|hit| hit.map(|hit| (hit.t, hit.primitive.0))).collect()
        };
        let whole = Bvh8::build(&database);
        let expected = hits(&whole);
        let leaves = whole.leaf_paths();
        assert!(leaves.len() > 50, "{}", leaves.len());
        let mut built = whole.clone();
        for (path, _) in &leaves {
            built.replace(&database, path, &[]);
        }
        assert!(hits(&built).iter().all(Option::is_none));
        // Each leaf gets what another one had: boxes have to follow.
        for ((path, _), (_, ids)) in leaves.iter().zip(leaves.iter().rev()) {
            built.replace(&database, path, ids);
        }
        assert_eq!(hits(&built), expected);
    }
}
