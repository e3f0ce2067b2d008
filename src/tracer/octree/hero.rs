//! HERO: octree traversal without coordinates, front to back.
//!
//! M. Agate, R. L. Grimsdale, P. F. Lister, *The HERO algorithm for ray-tracing octrees*, 1991, in the
//! iterative form: the stack holds one frame a level, a pop replaces the ascent to a common ancestor. The ray
//! parameter of every plane is computed once per ray and plane, by midpoint subdivision. Octants are mirrored
//! so that every direction is positive: along the ray, children only ever gain bits.

use super::mailbox::Mailbox;
use crate::database::Header;
use crate::database::Section;
use crate::database::records::{OctreeNode, OctreeWord, PrimitiveId};
use crate::tracer::hit::{Hit, HitOn};
use crate::tracer::memory_port::MemoryPort;
use crate::tracer::primitives::{cone, sphere, triangle::Shear};
use crate::tracer::ray::{Ray, Source};
use crate::tracer::stats::{LEVELS, TraceStats};

/// A branch on the way down.
#[derive(Clone, Copy, Default)]
struct Frame {
    /// Ray parameters of the cell's near planes, mid planes and far planes.
    near: [f32; 3],
    mid: [f32; 3],
    far: [f32; 3],
    /// Where the ray leaves the cell.
    leave: f32,
    /// Where it enters the child to visit next.
    enter: f32,
    block: u32,
    /// The child to visit next, mirrored; [`NO_CHILD`] when none is left.
    child: u32,
    /// Centre of the cell: only kept for rays parallel to a plane.
    centre: [f32; 3],
}

const NO_CHILD: u32 = 8;

/// What is computed once a ray.
struct Prepared<'a> {
    ray: &'a Ray,
    shear: Shear,
    /// Axes along which the ray runs downward, as an octant mask.
    mirror: u32,
    /// Axes along which it does not run at all.
    parallel: u32,
    near: [f32; 3],
    far: [f32; 3],
    enter: f32,
    leave: f32,
}

impl<'a> Prepared<'a> {
    /// `None` when the ray misses the root or is not finite.
    fn new(ray: &'a Ray) -> Option<Self> {
        let (mut mirror, mut parallel) = (0, 0);
        let (mut near, mut far) = ([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
        let (mut enter, mut leave) = (0.0f32, ray.t_max);
        for axis in 0..3 {
            let (o, d) = (ray.origin[axis], ray.direction[axis]);
            // Below this, 1/d or its product with a distance would overflow; −0 is one of them.
            if d.abs() < f32::MIN_POSITIVE {
                parallel |= 1 << axis;
                if !(o.abs() <= 1.0) {
                    return None;
                }
                continue;
            }
            let inverse = 1.0 / d;
            let (lower, upper) = ((-1.0 - o) * inverse, (1.0 - o) * inverse);
            mirror |= u32::from(d < 0.0) << axis;
            (near[axis], far[axis]) = if d < 0.0 { (upper, lower) } else { (lower, upper) };
            enter = if near[axis] > enter { near[axis] } else { enter };
            leave = if far[axis] < leave { far[axis] } else { leave };
        }
        // All three parallel: no direction at all. The comparison is false for NaN.
        if parallel == 0b111 || !(enter <= leave) {
            return None;
        }
        Some(Self { ray, shear: Shear::new(ray), mirror, parallel, near, far, enter, leave })
    }
}

/// Walks the octree of one database; keeps the stack and the mailbox from ray to ray.
pub struct Hero {
    stack: Box<[Frame; LEVELS]>,
    mailbox: Option<Mailbox>,
    max_depth: u32,
    triangles: u32,
    spheres: u32,
    primitives: u32,
}

impl Hero {
    /// For a database with this header.
    pub fn new(header: &Header, mailbox: bool) -> Self {
        let count = |section| header.layout.span(section).records as u32;
        let (triangles, spheres) = (count(Section::Triangles), count(Section::Spheres));
        Self {
            stack: Box::new([Frame::default(); LEVELS]),
            mailbox: mailbox.then(Mailbox::new),
            max_depth: header.max_depth.min(LEVELS as u32 - 1),
            triangles,
            spheres,
            primitives: triangles + spheres + count(Section::Cones),
        }
    }

    /// The nearest hit: the minimum of (t, id) over all primitives, whatever the octree.
    ///
    /// # Errors
    /// Those of the port, and a corrupt octree.
    pub fn nearest<M: MemoryPort>(
        &mut self,
        port: &mut M,
        ray: &Ray,
        stats: &mut TraceStats,
    ) -> Result<Option<Hit>, M::Error> {
        let mut best = None;
        self.trace::<M, false>(port, ray, &mut best, stats)?;
        Ok(best)
    }

    /// Whether anything is hit before `t_max`.
    ///
    /// # Errors
    /// Those of the port, and a corrupt octree.
    pub fn occluded<M: MemoryPort>(
        &mut self,
        port: &mut M,
        ray: &Ray,
        stats: &mut TraceStats,
    ) -> Result<bool, M::Error> {
        let mut best = None;
        self.trace::<M, true>(port, ray, &mut best, stats)?;
        Ok(best.is_some())
    }

    fn trace<M: MemoryPort, const ANY: bool>(
        &mut self,
        port: &mut M,
        ray: &Ray,
        best: &mut Option<Hit>,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        let Some(prepared) = Prepared::new(ray) else { return Ok(()) };
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.next_ray();
        }
        if prepared.parallel == 0 {
            self.walk::<M, ANY, false>(port, &prepared, best, stats)
        } else {
            self.walk::<M, ANY, true>(port, &prepared, best, stats)
        }
    }

    fn walk<M: MemoryPort, const ANY: bool, const PARALLEL: bool>(
        &mut self,
        port: &mut M,
        prepared: &Prepared<'_>,
        best: &mut Option<Hit>,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        let (mut near, mut far) = (prepared.near, prepared.far);
        let (mut enter, mut leave) = (prepared.enter, prepared.leave);
        let mut centre = [0.0; 3];
        let mut level = 0u32;
        let mut word_index = 0;
        loop {
            stats.octree_accesses[level as usize] += 1;
            let word: OctreeWord = port.octree_node(word_index, level)?;
            match word.decode() {
                Some(OctreeNode::Branch(block)) => {
                    if level == self.max_depth {
                        return Err(port.corrupt("an octree deeper than its header says"));
                    }
                    let mid = middle::<PARALLEL>(prepared, near, far, centre);
                    let child = (0..3).fold(0, |child, a| child | u32::from(mid[a] <= enter) << a);
                    self.stack[level as usize] = Frame { near, mid, far, leave, enter, block, child, centre };
                    level += 1;
                }
                Some(OctreeNode::Leaf(first)) => {
                    self.test_leaf::<M, ANY>(port, prepared, first, best, stats)?;
                    if let Some(hit) = best
                        && (ANY || hit.t <= leave)
                    {
                        return Ok(());
                    }
                }
                Some(OctreeNode::EmptyLeaf) => {}
                None => return Err(port.corrupt("an octree node of an unknown kind")),
            }
            // On to the next child of the deepest branch that has one.
            let frame = loop {
                if level == 0 {
                    return Ok(());
                }
                let frame = &mut self.stack[level as usize - 1];
                if frame.child != NO_CHILD {
                    break frame;
                }
                level -= 1;
            };
            enter = frame.enter;
            // Everything from here on lies beyond. Exact: the leaf that a hit's own t falls into lists it.
            if let Some(hit) = best
                && hit.t < enter
            {
                return Ok(());
            }
            let child = frame.child;
            let mut crossed = NO_CHILD;
            leave = frame.leave;
            for axis in 0..3 {
                let upper = child >> axis & 1 == 1;
                near[axis] = if upper { frame.mid[axis] } else { frame.near[axis] };
                far[axis] = if upper { frame.far[axis] } else { frame.mid[axis] };
                if !upper && frame.mid[axis] < leave {
                    leave = frame.mid[axis];
                    crossed = child | 1 << axis;
                }
            }
            frame.enter = leave;
            frame.child = crossed;
            let octant = child ^ prepared.mirror;
            if PARALLEL {
                (near, far) = keep_parallel(prepared, frame, near, far);
                let half = 1.0 / (1u32 << level) as f32;
                centre = std::array::from_fn(|a| frame.centre[a] + if octant >> a & 1 == 1 { half } else { -half });
            }
            word_index = frame.block * 8 + octant;
        }
    }

    #[inline(always)]
    fn test_leaf<M: MemoryPort, const ANY: bool>(
        &mut self,
        port: &mut M,
        prepared: &Prepared<'_>,
        first: u32,
        best: &mut Option<Hit>,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        let mut index = first;
        loop {
            let entry = port.leaf_entry(index)?;
            let primitive = entry.primitive();
            if self.mailbox.as_mut().is_some_and(|m| m.seen(primitive)) {
                stats.mailbox_skips += 1;
            } else {
                stats.primitive_tests += 1;
                self.test(port, prepared, primitive, best)?;
            }
            if entry.is_last() || (ANY && best.is_some()) {
                return Ok(());
            }
            index += 1;
        }
    }

    #[inline(always)]
    fn test<M: MemoryPort>(
        &self,
        port: &mut M,
        prepared: &Prepared<'_>,
        primitive: PrimitiveId,
        best: &mut Option<Hit>,
    ) -> Result<(), M::Error> {
        let ray = prepared.ray;
        let hit = if primitive.0 < self.triangles {
            let triangle = port.triangle(primitive.0)?;
            // Asked first: a ray that starts on the triangle is what f64 cannot decide.
            if ray.source == Source::Polygon(triangle.polygon()) {
                return Ok(());
            }
            prepared.shear.intersect(&triangle).and_then(|hit| {
                let on = || HitOn::Triangle { triangle, barycentrics: hit.barycentrics() };
                nearer(ray, primitive, hit.t, on, best)
            })
        } else if primitive.0 < self.triangles + self.spheres {
            let sphere = port.sphere(primitive.0 - self.triangles)?;
            sphere::intersect(ray, &sphere, ray.source == Source::Curved(primitive.0))
                .and_then(|t| nearer(ray, primitive, t, || HitOn::Sphere { sphere, t }, best))
        } else if primitive.0 < self.primitives {
            let cone = port.cone(primitive.0 - self.triangles - self.spheres)?;
            cone::intersect(ray, &cone, ray.source == Source::Curved(primitive.0))
                .and_then(|t| nearer(ray, primitive, t, || HitOn::Cone { cone, t }, best))
        } else {
            return Err(port.corrupt("a primitive in a leaf that does not exist"));
        };
        if hit.is_some() {
            *best = hit;
        }
        Ok(())
    }
}

/// The hit, if it is in the ray's range and nearer than the best so far.
#[inline(always)]
fn nearer(ray: &Ray, primitive: PrimitiveId, t: f64, on: impl FnOnce() -> HitOn, best: &Option<Hit>) -> Option<Hit> {
    let t = t as f32;
    (t < ray.t_max && Hit::is_nearer(t, primitive, best.as_ref())).then(|| Hit { t, primitive, on: on() })
}

/// Ray parameters of the mid planes. Where the ray is parallel to a plane it stays on one side for ever: in the
/// upper half if it lies in the plane itself, which is safe since building lists what is there on both sides.
#[inline(always)]
fn middle<const PARALLEL: bool>(prepared: &Prepared<'_>, near: [f32; 3], far: [f32; 3], centre: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|a| {
        if PARALLEL && prepared.parallel >> a & 1 == 1 {
            if prepared.ray.origin[a] < centre[a] { f32::INFINITY } else { f32::NEG_INFINITY }
        } else {
            0.5 * near[a] + 0.5 * far[a]
        }
    })
}

/// A parallel ray's planes stay at infinity, whichever half it is in.
fn keep_parallel(
    prepared: &Prepared<'_>,
    frame: &Frame,
    mut near: [f32; 3],
    mut far: [f32; 3],
) -> ([f32; 3], [f32; 3]) {
    for a in (0..3).filter(|a| prepared.parallel >> a & 1 == 1) {
        (near[a], far[a]) = (frame.near[a], frame.far[a]);
    }
    (near, far)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::database::records::Triangle;
    use crate::database::verify::Verified;
    use crate::scene::{Cone, Material, Polygon, Scene, Sphere};
    use crate::tracer::octree::{BuildParameters, build_database};
    use crate::tracer::slices::Slices;

    fn unit(random: &mut Pcg32) -> f64 {
        f64::from(random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    fn vector(random: &mut Pcg32) -> DVec3 {
        DVec3::new(unit(random), unit(random), unit(random))
    }

    /// Triangles of many sizes, some axis-parallel through the octree's own planes, spheres and cones.
    fn soup(random: &mut Pcg32, count: usize) -> Scene {
        let mut scene =
            Scene { materials: vec![Material::from_nff(DVec3::ONE, 1.0, 0.0, 1.0, 0.0, 1.0)], ..Scene::default() };
        for i in 0..count {
            let size = 10f64.powf(unit(random) * 1.5 - 1.0);
            let (at, flat) = (vector(random), i % 5 == 0);
            let mut corner = || {
                let mut v = at + vector(random) * size;
                if flat {
                    v[i % 3] = 0.25 * (i % 8) as f64 - 1.0;
                }
                v
            };
            let first_vertex = scene.vertices.len() as u32;
            let corners = [corner(), corner(), corner()];
            scene.vertices.extend(corners);
            scene.polygons.push(Polygon { first_vertex, vertex_count: 3, first_normal: None, material: 0 });
            if i % 7 == 0 {
                scene.spheres.push(Sphere { centre: vector(random), radius: unit(random) * 0.3, material: 0 });
                scene.cones.push(Cone {
                    base: vector(random),
                    base_radius: 0.1 + unit(random).abs() * 0.2,
                    apex: vector(random),
                    apex_radius: unit(random).abs() * 0.2,
                    material: 0,
                });
            }
        }
        scene
    }

    /// Rays inside the root; some parallel to one or two axes, some starting on the octree's planes.
    fn ray(random: &mut Pcg32, i: usize) -> Ray {
        let mut origin = vector(random) * 0.99;
        let mut direction = vector(random).normalize();
        if i % 3 == 1 {
            direction[i % 2] = if i.is_multiple_of(4) { -0.0 } else { 0.0 };
            origin[i % 2] = 0.125 * (i % 16) as f64 - 1.0;
        }
        if i % 6 == 4 {
            direction[2] = 1e-42;
        }
        if i % 11 == 5 {
            direction = DVec3::ZERO;
            direction[i % 3] = 1.0;
            origin[(i + 1) % 3] = 0.0;
        }
        Ray {
            origin: origin.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            t_max: f32::INFINITY,
            source: Source::Eye,
        }
    }

    /// Minimum of (t, id) over all primitives.
    fn brute_force(database: &Verified, ray: &Ray) -> Option<(f32, u32)> {
        let triangles: &[Triangle] = database.database().records(Section::Triangles);
        let spheres: &[crate::database::records::Sphere] = database.database().records(Section::Spheres);
        let cones: &[crate::database::records::Cone] = database.database().records(Section::Cones);
        let shear = Shear::new(ray);
        let ts = triangles
            .iter()
            .map(|t| shear.intersect(t).map(|hit| hit.t))
            .chain(spheres.iter().map(|s| sphere::intersect(ray, s, false)))
            .chain(cones.iter().map(|c| cone::intersect(ray, c, false)));
        ts.enumerate()
            .filter_map(|(id, t)| t.map(|t| (t as f32, id as u32)))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    }

    #[test]
    fn nearest_hit_is_the_brute_force_minimum_for_any_octree() {
        let mut random = Pcg32::seed_from_u64(1);
        let scene = soup(&mut random, 300);
        let rays: Vec<Ray> = (0..4000).map(|i| ray(&mut random, i)).collect();
        let mut hits = 0;
        for (leaf_size, max_depth, mailbox) in
            [(1, 0, true), (1, 6, true), (4, 9, false), (12, 10, true), (3, 12, true)]
        {
            let database = build_database(&scene, BuildParameters { leaf_size, max_depth }).expect("builds");
            let mut port = Slices::new(&database);
            let mut hero = Hero::new(&database.database().header, mailbox);
            let mut stats = TraceStats::default();
            for (i, ray) in rays.iter().enumerate() {
                let expected = brute_force(&database, ray);
                let Ok(found) = hero.nearest(&mut port, ray, &mut stats);
                let found = found.map(|hit| (hit.t, hit.primitive.0));
                assert_eq!(found, expected, "ray {i} of octree {leaf_size}/{max_depth}: {ray:?}");
                let Ok(occluded) = hero.occluded(&mut port, ray, &mut stats);
                assert_eq!(occluded, expected.is_some(), "shadow ray {i} of octree {leaf_size}/{max_depth}");
                hits += usize::from(expected.is_some());
            }
        }
        assert!(hits > 5000, "only {hits} hits");
    }

    #[test]
    fn a_ray_without_direction_or_not_finite_hits_nothing() {
        let scene = soup(&mut Pcg32::seed_from_u64(2), 50);
        let database = build_database(&scene, BuildParameters { leaf_size: 4, max_depth: 6 }).expect("builds");
        let mut hero = Hero::new(&database.database().header, true);
        let bad = [
            ([0.0; 3], [0.0; 3]),
            ([0.0; 3], [f32::NAN, 0.0, 1.0]),
            ([f32::NAN, 0.0, 0.0], [0.0, 0.0, 1.0]),
            ([0.0; 3], [1e-40, -1e-41, 0.0]),
            ([0.0, 2.0, 0.0], [1.0, 0.0, 0.0]),
        ];
        for (origin, direction) in bad {
            let ray = Ray { origin, direction, t_max: f32::INFINITY, source: Source::Eye };
            let Ok(hit) = hero.nearest(&mut Slices::new(&database), &ray, &mut TraceStats::default());
            assert!(hit.is_none(), "{ray:?}");
        }
    }
}
