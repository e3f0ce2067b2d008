//! The nearest hit over all primitives, and whether the tracer's is one that may be.

use glam::DVec3;

use super::curved::{Crossing, cone_hits, sphere_hits};
use super::triangle;
use crate::database::primitives::{Primitive, Primitives};
use crate::database::records::{Cone, PrimitiveId, Triangle};
use crate::database::verify::Verified;
use crate::tracer::hit::Hit;
use crate::tracer::ray::{Ray, Source};

/// Depths closer than this, relatively, are one depth: four times the rounding of f32.
pub const SAME_DEPTH: f64 = 1.0 / (1 << 22) as f64;

/// All primitives of a database. Each is asked whose bounding box the ray's line meets, found by going through
/// all boxes: the octree has no say.
pub struct BruteForce<'a> {
    primitives: Primitives<'a>,
    /// By primitive id.
    boxes: Vec<Bounds>,
    /// Around each [`GROUP`] of boxes in the order of ids.
    groups: Vec<Bounds>,
}

const GROUP: usize = 64;

/// A primitive that the ray hits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    pub primitive: PrimitiveId,
    pub crossing: Crossing,
}

/// What may be the nearest hit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    /// Depth of the nearest certain hit.
    pub nearest: Option<f64>,
    /// By id: every primitive that is hit no farther than that, within [`SAME_DEPTH`], and every uncertain one.
    pub candidates: Vec<Candidate>,
}

/// How a hit of the tracer compares with the answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// The same hit, or none, with the relative error of the depth beyond the oracle's own.
    Agrees { depth_error: f64 },
    /// Another primitive than the first in (depth, id), as near as it.
    OtherPrimitive { depth_error: f64 },
    /// There is a nearer hit, or there is one at all.
    Lost,
    /// The primitive is not hit there.
    False,
}

impl<'a> BruteForce<'a> {
    pub fn new(verified: &'a Verified) -> Self {
        let primitives = Primitives::of(verified);
        let spheres = primitives.spheres.iter().map(|s| Bounds::of_ball(s.centre, s.radius));
        let ends = |c: &Cone| [Bounds::of_ball(c.base, c.base_radius), Bounds::of_ball(c.apex, c.apex_radius)];
        let cones = primitives.cones.iter().map(ends).map(|[base, apex]| base.union(apex));
        let boxes: Vec<Bounds> =
            primitives.triangles.iter().map(Bounds::of_triangle).chain(spheres).chain(cones).collect();
        let groups = boxes.chunks(GROUP).map(|group| group.iter().copied().fold(group[0], Bounds::union)).collect();
        Self { primitives, boxes, groups }
    }

    /// What may be the nearest hit of the ray with depth at or after its origin and before `t_max`.
    ///
    /// A ray that is not finite, or whose direction has no component that is a normal f32, hits nothing.
    pub fn nearest(&self, ray: &Ray) -> Answer {
        let mut answer = Answer::default();
        let finite = ray.origin.iter().chain(&ray.direction).all(|c| c.is_finite());
        if !finite || ray.direction.iter().all(|d| d.abs() < f32::MIN_POSITIVE) {
            return answer;
        }
        let line = Line { origin: ray.origin_f64(), direction: ray.direction_f64() };
        for (group, bounds) in self.groups.iter().enumerate() {
            if !line.meets(bounds) {
                continue;
            }
            let first = group * GROUP;
            let end = self.boxes.len().min(first + GROUP);
            for id in (first..end).filter(|&id| line.meets(&self.boxes[id])) {
                self.ask(ray, PrimitiveId(id as u32), &mut answer);
            }
        }
        let farthest = answer.nearest.unwrap_or(f64::INFINITY) * (1.0 + SAME_DEPTH);
        answer.candidates.retain(|c| c.crossing.t - c.crossing.error <= farthest);
        answer
    }

    fn ask(&self, ray: &Ray, primitive: PrimitiveId, answer: &mut Answer) {
        let leaving = ray.source == Source::Curved(primitive.0);
        let crossings = match self.primitives.get(primitive) {
            Some(Primitive::Triangle(triangle)) => {
                let own = ray.source == Source::Polygon(triangle.polygon());
                let hit = if own { None } else { triangle::hit(ray, triangle) };
                hit.map(|t| Crossing { t, error: 0.0, certain: true }).into_iter().collect()
            }
            Some(Primitive::Sphere(sphere)) => sphere_hits(ray, sphere, leaving),
            Some(Primitive::Cone(cone)) => cone_hits(ray, cone, leaving),
            None => Vec::new(),
        };
        for crossing in crossings.into_iter().filter(|c| (c.t as f32) < ray.t_max) {
            if crossing.certain {
                answer.nearest = Some(answer.nearest.map_or(crossing.t, |t| t.min(crossing.t)));
            }
            answer.candidates.push(Candidate { primitive, crossing });
        }
    }
}

impl Answer {
    /// The primitives that may be the nearest, in the order of ids.
    pub fn ids(&self) -> Vec<u32> {
        let mut ids: Vec<u32> = self.candidates.iter().map(|c| c.primitive.0).collect();
        ids.dedup();
        ids
    }

    pub fn judge(&self, hit: Option<&Hit>) -> Verdict {
        let Some(hit) = hit else {
            return if self.nearest.is_some() { Verdict::Lost } else { Verdict::Agrees { depth_error: 0.0 } };
        };
        let t = f64::from(hit.t);
        let beyond = |c: &Crossing| ((t - c.t).abs() - c.error).max(0.0) / t.abs().max(f64::MIN_POSITIVE);
        let same = self
            .candidates
            .iter()
            .filter(|c| c.primitive == hit.primitive)
            .map(|c| beyond(&c.crossing))
            .min_by(f64::total_cmp);
        match same {
            Some(depth_error) if depth_error <= SAME_DEPTH => {
                if self.first() == Some(hit.primitive) {
                    Verdict::Agrees { depth_error }
                } else {
                    Verdict::OtherPrimitive { depth_error }
                }
            }
            _ if self.nearest.is_some_and(|nearest| t > nearest * (1.0 + SAME_DEPTH)) => Verdict::Lost,
            _ => Verdict::False,
        }
    }

    /// The first in (depth rounded to f32, id).
    fn first(&self) -> Option<PrimitiveId> {
        let order = |c: &Candidate| c.crossing.t as f32;
        let nearer = |a: &&Candidate, b: &&Candidate| order(a).total_cmp(&order(b)).then(a.primitive.cmp(&b.primitive));
        self.candidates.iter().min_by(nearer).map(|c| c.primitive)
    }
}

#[derive(Clone, Copy, Debug)]
struct Bounds {
    lo: DVec3,
    hi: DVec3,
}

impl Bounds {
    fn of_triangle(triangle: &Triangle) -> Self {
        let [a, b, c] = triangle.vertices();
        Self { lo: a.min(b).min(c), hi: a.max(b).max(c) }
    }

    fn of_ball(centre: [f32; 3], radius: f32) -> Self {
        let (centre, radius) = (DVec3::from(centre.map(f64::from)), f64::from(radius.abs()));
        Self { lo: centre - radius, hi: centre + radius }
    }

    fn union(self, other: Self) -> Self {
        Self { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }
}

struct Line {
    origin: DVec3,
    direction: DVec3,
}

impl Line {
    /// Boxes are widened by this, normalised units: far above the rounding of a plane's distance, so that the
    /// widened interval of each axis holds the true one.
    const WIDER: f64 = 1e-12;

    /// Whether the line, ahead or behind, may meet the box.
    fn meets(&self, bounds: &Bounds) -> bool {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let (o, d) = (self.origin[axis], self.direction[axis]);
            let (lo, hi) = (bounds.lo[axis] - Self::WIDER, bounds.hi[axis] + Self::WIDER);
            if d == 0.0 {
                if o < lo || o > hi {
                    return false;
                }
                continue;
            }
            let (a, b) = ((lo - o) / d, (hi - o) / d);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }
}
