//! The tracer held against the oracle, ray by ray.

use serde::Serialize;

use super::brute_force::{Answer, BruteForce, Verdict};
use super::rays::{AimedAt, Rays};
use crate::database::verify::Verified;
use crate::tracer::hit::Hit;
use crate::tracer::octree::hero::Hero;
use crate::tracer::ray::{Ray, Source};
use crate::tracer::slices::Slices;
use crate::tracer::{TraceStats, View};

/// What came of some rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Counts {
    pub rays: u64,
    /// Rays for which the tracer found a hit.
    pub hits: u64,
    /// The same hit, or none, in both.
    pub agreeing: u64,
    /// Rays whose nearest hit the tracer did not find.
    pub lost: u64,
    /// Rays for which the tracer found what is not there.
    #[serde(rename = "false")]
    pub false_hits: u64,
    /// Another primitive than the oracle's first, as near as that one within the rounding of f32.
    pub other_primitive: u64,
    /// Hits on what the ray leaves from, where the oracle has none.
    pub self_hits: u64,
    /// Of the rays that agree, beyond the oracle's own error; relative to the depth.
    pub worst_depth_error: f64,
}

/// A ray on which tracer and oracle do not agree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Disagreement {
    pub aimed_at: AimedAt,
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    /// Depth and primitive that the tracer found.
    pub found: Option<(f32, u32)>,
    /// Depth and primitives of the oracle.
    pub nearest: Option<f64>,
    pub candidates: Vec<u32>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verification {
    #[serde(flatten)]
    pub total: Counts,
    /// By [`AimedAt`].
    pub by_aim: [Counts; AimedAt::COUNT],
    /// The first of them.
    pub disagreements: Vec<Disagreement>,
}

/// Disagreements that are told in full.
const TOLD: usize = 8;

impl Counts {
    fn add(&mut self, hit: Option<&Hit>, self_hit: bool, verdict: Verdict) {
        self.rays += 1;
        self.hits += u64::from(hit.is_some());
        match verdict {
            Verdict::Agrees { depth_error } => {
                self.agreeing += 1;
                self.worst_depth_error = self.worst_depth_error.max(depth_error);
            }
            Verdict::OtherPrimitive { depth_error } => {
                self.other_primitive += 1;
                self.worst_depth_error = self.worst_depth_error.max(depth_error);
            }
            Verdict::Lost => self.lost += 1,
            Verdict::False => self.false_hits += 1,
        }
        self.self_hits += u64::from(self_hit);
    }

    fn sum(&mut self, other: &Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.agreeing += other.agreeing;
        self.lost += other.lost;
        self.false_hits += other.false_hits;
        self.other_primitive += other.other_primitive;
        self.self_hits += other.self_hits;
        self.worst_depth_error = self.worst_depth_error.max(other.worst_depth_error);
    }
}

impl Verification {
    /// Whether the tracer lost nothing and made nothing up.
    pub fn holds(&self) -> bool {
        self.total.lost == 0 && self.total.false_hits == 0
    }

    fn add(&mut self, aim: AimedAt, ray: &Ray, hit: Option<&Hit>, answer: &Answer) {
        let verdict = answer.judge(hit);
        let wrong = matches!(verdict, Verdict::Lost | Verdict::False);
        let self_hit = match (ray.source, hit.map(|h| (h.on, h.primitive.0))) {
            (Source::Polygon(own), Some((crate::tracer::hit::HitOn::Triangle { triangle, .. }, _))) => {
                triangle.polygon() == own
            }
            (Source::Curved(own), Some((_, primitive))) => primitive == own && wrong,
            _ => false,
        };
        self.by_aim[aim as usize].add(hit, self_hit, verdict);
        if wrong && self.disagreements.len() < TOLD {
            self.disagreements.push(Disagreement {
                aimed_at: aim,
                origin: ray.origin,
                direction: ray.direction,
                found: hit.map(|h| (h.t, h.primitive.0)),
                nearest: answer.nearest,
                candidates: answer.ids(),
            });
        }
    }
}

/// Shoots `rays` rays, of all kinds in turn, through HERO and through the oracle.
pub fn verify(database: &Verified, view: &View, rays: u64, seed: u64) -> Verification {
    let oracle = BruteForce::new(database);
    let mut port = Slices::new(database);
    let mut hero = Hero::new(&database.database().header, true);
    let mut stats = TraceStats::default();
    let mut source = Rays::new(database, view, seed);
    let mut found = Verification::default();
    let mut last_surface = None;
    for (_, mut aim) in (0..rays).zip(AimedAt::ALL.into_iter().cycle()) {
        let chosen = match aim {
            AimedAt::Pixel => source.through_pixel(),
            AimedAt::Anywhere => None,
            AimedAt::AlongAxes => Some(source.along_axes()),
            AimedAt::Edge => Some(source.at_edge()),
            AimedAt::FromSurface => leaving(last_surface.take(), &mut source),
        };
        // Where there is no such ray, as from a surface before any was hit, it is one aimed anywhere.
        let ray = chosen.unwrap_or_else(|| {
            aim = AimedAt::Anywhere;
            source.anywhere()
        });
        let Ok(hit) = hero.nearest(&mut port, &ray, &mut stats);
        found.add(aim, &ray, hit.as_ref(), &oracle.nearest(&ray));
        if let Some(hit) = hit {
            last_surface = Some((ray, hit));
        }
    }
    for counts in found.by_aim {
        found.total.sum(&counts);
    }
    found
}

/// A ray from a hit's surface, to either side of it.
fn leaving(surface: Option<(Ray, Hit)>, source: &mut Rays<'_>) -> Option<Ray> {
    let (ray, hit) = surface?;
    let point = hit.surface_point(&ray);
    let direction = source.direction();
    Some(Ray::leaving(point.position, point.normal, direction, f32::INFINITY, point.source))
}
