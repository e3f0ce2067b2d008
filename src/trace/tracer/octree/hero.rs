//! HERO: octree traversal without coordinates, front to back.
//!
//! M. Agate, R. L. Grimsdale, P. F. Lister, *The HERO algorithm for ray-tracing octrees*, 1991, in the
//! iterative form: the stack holds the branches that have children left, a pop replaces the ascent to a common
//! ancestor. The ray parameter of every plane is computed once per ray and plane, by midpoint subdivision. Octants are mirrored
//! so that every direction is positive: along the ray, children only ever gain bits.

use super::descent::{Branch, Step};
use super::mailbox::Mailbox;
use super::prepared::Prepared;
use crate::database::primitives::PrimitiveCounts;
use crate::database::records::LEVELS;
use crate::database::records::{OctreeNode, OctreeWord, PrimitiveId, Triangle};
use crate::database::{Header, Section};
use crate::tracer::hit::{Hit, HitOn};
use crate::tracer::memory_port::MemoryPort;
use crate::tracer::primitives::four_triangles::FourTriangles;
use crate::tracer::primitives::triangle::TriangleHit;
use crate::tracer::ray::Ray;
use crate::tracer::stats::TraceStats;

/// The nearest hit so far, or the end of the ray.
struct Best {
    t: f32,
    /// Of two hits with the same t the one with the lower id counts; at the ray's end none does.
    primitive: PrimitiveId,
    on: On,
}

enum On {
    Nothing,
    Triangle(Triangle, TriangleHit),
    Curved(HitOn),
}

impl Best {
    fn new(ray: &Ray) -> Self {
        Self { t: ray.t_max, primitive: PrimitiveId(0), on: On::Nothing }
    }

    #[inline(always)]
    fn is_hit(&self) -> bool {
        !matches!(self.on, On::Nothing)
    }

    #[inline(always)]
    fn offer(&mut self, t: f64, primitive: PrimitiveId, on: impl FnOnce() -> On) {
        let t = t as f32;
        if t < self.t || (t == self.t && primitive < self.primitive) {
            *self = Self { t, primitive, on: on() };
        }
    }

    fn into_hit(self) -> Option<Hit> {
        let on = match self.on {
            On::Nothing => return None,
            On::Triangle(triangle, hit) => HitOn::Triangle { triangle, barycentrics: hit.barycentrics() },
            On::Curved(on) => on,
        };
        Some(Hit { t: self.t, primitive: self.primitive, on })
    }
}

/// Walks the octree of one database; keeps the stack and the mailbox from ray to ray.
pub struct Hero {
    stack: Box<[Branch; LEVELS]>,
    mailbox: Option<Mailbox>,
    /// Triangles of a leaf that are tested together, and their ids.
    four: Box<FourTriangles>,
    ids: [PrimitiveId; 4],
    max_depth: u32,
    counts: PrimitiveCounts,
    /// Objects below this are triangles: none of them where polygons are objects.
    triangle_objects: u32,
    /// Objects below this are polygons, where they are.
    polygon_objects: u32,
}

impl Hero {
    /// For a database with this header.
    pub fn new(header: &Header, mailbox: bool) -> Self {
        let counts = PrimitiveCounts::of(&header.layout);
        let has_polygons = header.layout.has_polygons();
        Self {
            stack: Box::new([Branch::default(); LEVELS]),
            mailbox: mailbox.then(Mailbox::new),
            four: Box::default(),
            ids: [PrimitiveId(0); 4],
            max_depth: header.max_depth.min(LEVELS as u32 - 1),
            counts,
            triangle_objects: if has_polygons { 0 } else { counts.triangles },
            polygon_objects: header.layout.span(Section::Polygons).records as u32,
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
        let mut best = Best::new(ray);
        self.trace::<M, false>(port, ray, &mut best, stats)?;
        Ok(best.into_hit())
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
        let mut best = Best::new(ray);
        self.trace::<M, true>(port, ray, &mut best, stats)?;
        Ok(best.is_hit())
    }

    fn trace<M: MemoryPort, const ANY: bool>(
        &mut self,
        port: &mut M,
        ray: &Ray,
        best: &mut Best,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        let Some(prepared) = Prepared::new(ray) else { return Ok(()) };
        if let Some(mailbox) = &mut self.mailbox {
            mailbox.next_ray();
        }
        let mut step = Step::root(prepared.near, prepared.far, prepared.enter, prepared.leave);
        // The branches below this have children left.
        let mut depth = 0usize;
        loop {
            stats.octree_accesses[step.level as usize] += 1;
            let word: OctreeWord = port.octree_node(step.word, step.level)?;
            match word.decode() {
                Some(OctreeNode::Branch(block)) => {
                    if step.level == self.max_depth {
                        return Err(port.corrupt("an octree deeper than its header says"));
                    }
                    let mid = prepared.middle(step.near, step.far, step.level);
                    let (branch, first) = Branch::enter(step, mid, block << 3 ^ prepared.mirror);
                    self.stack[depth] = branch;
                    depth += usize::from(!first.is_last);
                    step = first;
                    continue;
                }
                Some(OctreeNode::EmptyLeaf) => {}
                Some(OctreeNode::Leaf(first)) => {
                    self.test_leaf::<M, ANY>(port, &prepared, first, best, stats)?;
                    if best.t <= step.leave || (ANY && best.is_hit()) {
                        return Ok(());
                    }
                }
                None => return Err(port.corrupt("an octree node of an unknown kind")),
            }
            if depth == 0 {
                return Ok(());
            }
            let branch = &mut self.stack[depth - 1];
            // Everything from here on lies beyond. Exact: the leaf that a hit's own t falls into lists it.
            if best.t < branch.enter {
                return Ok(());
            }
            step = branch.step();
            depth -= usize::from(step.is_last);
        }
    }

    #[inline(always)]
    fn test_leaf<M: MemoryPort, const ANY: bool>(
        &mut self,
        port: &mut M,
        prepared: &Prepared<'_>,
        first: u32,
        best: &mut Best,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        let mut index = first;
        loop {
            let mut count = 0;
            let last = loop {
                let entry = port.leaf_entry(index)?;
                let object = entry.primitive();
                index += 1;
                if self.mailbox.as_mut().is_some_and(|m| m.seen(object)) {
                    stats.mailbox_skips += 1;
                } else {
                    stats.primitive_tests += 1;
                    if object.0 < self.triangle_objects {
                        self.four.put(count, &port.triangle(object.0)?);
                        self.ids[count & 3] = object;
                        count += 1;
                    } else {
                        self.test_other::<M, ANY>(port, prepared, object, best, stats)?;
                        if ANY && best.is_hit() {
                            return Ok(());
                        }
                    }
                }
                if entry.is_last() || count == 4 {
                    break entry.is_last();
                }
            };
            let mut candidates = prepared.shear.candidates(&self.four) & ((1 << count) - 1);
            while candidates != 0 {
                let lane = candidates.trailing_zeros() as usize;
                candidates &= candidates - 1;
                test_triangle(prepared, &self.four, lane, self.ids[lane & 3], best);
            }
            if last || (ANY && best.is_hit()) {
                return Ok(());
            }
        }
    }

    /// Tests a sphere, a cone, or a polygon as a whole.
    #[inline(never)]
    fn test_other<M: MemoryPort, const ANY: bool>(
        &self,
        port: &mut M,
        prepared: &Prepared<'_>,
        object: PrimitiveId,
        best: &mut Best,
        stats: &mut TraceStats,
    ) -> Result<(), M::Error> {
        if object.0 < self.polygon_objects {
            return test_polygon::<M, ANY>(port, prepared, object.0, best, stats);
        }
        // Its number as a primitive: there are triangles before it, not polygons.
        let primitive = PrimitiveId(match self.polygon_objects {
            0 => object.0,
            polygons => (object.0 - polygons).saturating_add(self.counts.triangles),
        });
        let ray = prepared.ray;
        let Some(index) = self.counts.locate(primitive) else {
            return Err(port.corrupt("a primitive in a leaf that does not exist"));
        };
        if let Some((t, on)) = HitOn::curved(port, ray, primitive, index)? {
            best.offer(t, primitive, || On::Curved(on));
        }
        Ok(())
    }
}

/// The polygon's record, then its triangles, four at a time: what is hit is the triangle. Whether anything is hit is known
/// after any four.
#[inline(never)]
fn test_polygon<M: MemoryPort, const ANY: bool>(
    port: &mut M,
    prepared: &Prepared<'_>,
    index: u32,
    best: &mut Best,
    stats: &mut TraceStats,
) -> Result<(), M::Error> {
    let mut triangles = port.polygon(index)?.triangles();
    let mut four = FourTriangles::default();
    while !triangles.is_empty() {
        let (first, mut count) = (triangles.start, 0);
        for id in triangles.by_ref().take(4) {
            stats.polygon_triangles += 1;
            four.put(count, &port.triangle(id)?);
            count += 1;
        }
        let mut candidates = prepared.shear.candidates(&four) & ((1 << count) - 1);
        while candidates != 0 {
            let lane = candidates.trailing_zeros();
            candidates &= candidates - 1;
            test_triangle(prepared, &four, lane as usize, PrimitiveId(first + lane), best);
        }
        if ANY && best.is_hit() {
            break;
        }
    }
    Ok(())
}

#[inline(always)]
fn test_triangle(prepared: &Prepared<'_>, four: &FourTriangles, lane: usize, id: PrimitiveId, best: &mut Best) {
    let triangle = four.get(lane);
    if let Some(hit) = prepared.shear.hit(prepared.ray, &triangle) {
        best.offer(hit.t, id, || On::Triangle(triangle, hit));
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand_core::{Rng, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;
    use crate::database::primitives::Primitives;
    use crate::database::verify::Verified;
    use crate::database::{Numbers, Objects, RecordLayout};
    use crate::scene::{Cone, Material, Polygon, Scene, Sphere};
    use crate::tracer::octree::{BuildParameters, build_database, build_database_as};
    use crate::tracer::primitives::triangle::Shear;
    use crate::tracer::primitives::{cone, sphere};
    use crate::tracer::ray::Source;
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
            scene.polygons.push(Polygon {
                first_vertex,
                vertex_count: 3,
                first_normal: None,
                first_colour: None,
                material: 0,
            });
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

    /// The soup, in which triangles that follow one another are cut from polygons of four to seven corners.
    fn polygon_soup(random: &mut Pcg32, count: usize) -> Scene {
        let mut scene = soup(random, count);
        for i in 0..count / 4 {
            let (at, u, v) = (vector(random), vector(random) * 0.4, vector(random) * 0.4);
            let corners = 4 + i as u32 % 4;
            scene.polygons[i].first_vertex = scene.vertices.len() as u32;
            scene.polygons[i].vertex_count = corners;
            scene.vertices.extend((0..corners).map(|k| {
                let angle = f64::from(k) * std::f64::consts::TAU / f64::from(corners);
                let radius = if k % 2 == 0 { 1.0 } else { 0.3 };
                at + (u * angle.cos() + v * angle.sin()) * radius
            }));
        }
        scene
    }

    /// Minimum of (t, id) over all primitives.
    fn brute_force(database: &Verified, ray: &Ray) -> Option<(f32, u32)> {
        let Primitives { triangles, spheres, cones } = Primitives::of(database);
        let shear = Shear::new(ray);
        let ts = triangles
            .iter()
            .map(|t| shear.decide(t).map(|hit| hit.t))
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
        assert_brute_force(&mut random, &scene, RecordLayout::DEFAULT);
    }

    #[test]
    fn nearest_hit_is_the_brute_force_minimum_where_polygons_are_objects() {
        let mut random = Pcg32::seed_from_u64(3);
        let scene = polygon_soup(&mut random, 300);
        let layout = RecordLayout::new(Objects::Polygons, Numbers::F64, Some(60)).expect("possible");
        assert_brute_force(&mut random, &scene, layout);
    }

    fn assert_brute_force(random: &mut Pcg32, scene: &Scene, layout: RecordLayout) {
        let rays: Vec<Ray> = (0..4000).map(|i| ray(random, i)).collect();
        let mut hits = 0;
        for (leaf_size, max_depth, mailbox) in
            [(1, 0, true), (1, 6, true), (4, 9, false), (12, 10, true), (3, 12, true)]
        {
            let parameters = BuildParameters { leaf_size, max_depth };
            let database = build_database_as(scene, parameters, layout).expect("builds");
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
            ([0.0, 0.0, f32::NAN], [0.0, 0.0, 1.0]),
            ([0.1, 0.2, 0.3], [0.0, f32::NEG_INFINITY, 0.0]),
            ([0.1, 0.2, 0.3], [f32::INFINITY, 0.5, 0.5]),
            ([0.1, f32::INFINITY, 0.3], [0.0, -1.0, 0.0]),
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
