//! Every kernel held against the oracle, ray by ray, and against each other.

use serde::Serialize;

use super::brute_force::{Answer, BruteForce, Verdict};
use super::kernels::{Kernel, Subject};
use super::rays::{AimedAt, Rays};
use crate::database::verify::Verified;
use crate::tracer::View;
use crate::tracer::hit::{Hit, HitOn};
use crate::tracer::ray::{Ray, Source};

/// Rays that a kernel is given at once.
const BATCH: u64 = 256;

/// Faults that are reported in full.
const TOLD: usize = 8;

/// What came of some rays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Outcomes {
    pub rays: u64,
    /// Rays for which the kernel found a hit.
    pub hits: u64,
    /// The same hit, or none, in both.
    pub agreeing: u64,
    /// Rays whose nearest hit the kernel did not find.
    pub lost: u64,
    /// Rays for which the kernel found what is not there.
    #[serde(rename = "false")]
    pub false_hits: u64,
    /// Another primitive than the oracle's first, as near as that one within the rounding of f32.
    pub other_primitive: u64,
    /// Hits on what the ray leaves from, where the oracle has none.
    pub self_hits: u64,
    /// Rays for which the kernel's answer is not HERO's bit by bit, or for which it does not say that something is
    /// hit just where it finds a nearest hit.
    pub differing: u64,
    /// Of the rays that agree, beyond the oracle's own error; relative to the depth.
    pub worst_depth_error: f64,
}

/// What came of one kernel's rays.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KernelOutcomes {
    pub kernel: Kernel,
    #[serde(flatten)]
    pub total: Outcomes,
    /// By [`AimedAt`].
    pub by_aim: [Outcomes; AimedAt::COUNT],
}

/// What a kernel did wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    Lost,
    False,
    SelfHit,
    Differing,
}

/// A ray with which a kernel did something wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Disagreement {
    pub kernel: Kernel,
    pub fault: Fault,
    pub aimed_at: AimedAt,
    pub origin: [f32; 3],
    pub direction: [f32; 3],
    /// Depth and primitive that the kernel found.
    pub found: Option<(f32, u32)>,
    /// Depth and primitives of the oracle.
    pub nearest: Option<f64>,
    pub candidates: Vec<u32>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Verification {
    /// HERO first.
    pub kernels: Vec<KernelOutcomes>,
    /// The first of them.
    pub disagreements: Vec<Disagreement>,
}

/// A ray, what HERO makes of it, and what the oracle does.
struct Question {
    aim: AimedAt,
    ray: Ray,
    hero: Option<Hit>,
    answer: Answer,
}

impl Outcomes {
    fn add(&mut self, hit: Option<&Hit>, verdict: Verdict, self_hit: bool, differing: bool) {
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
        self.differing += u64::from(differing);
    }

    pub fn sum(&mut self, other: &Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.agreeing += other.agreeing;
        self.lost += other.lost;
        self.false_hits += other.false_hits;
        self.other_primitive += other.other_primitive;
        self.self_hits += other.self_hits;
        self.differing += other.differing;
        self.worst_depth_error = self.worst_depth_error.max(other.worst_depth_error);
    }

    /// Whether nothing was lost or made up, and every kernel says the same.
    pub fn hold(&self) -> bool {
        self.lost == 0 && self.false_hits == 0 && self.self_hits == 0 && self.differing == 0
    }
}

impl Verification {
    pub fn holds(&self) -> bool {
        self.kernels.iter().all(|kernel| kernel.total.hold())
    }

    fn add(&mut self, which: usize, question: &Question, hit: Option<&Hit>, occluded: bool) {
        let Question { aim, ray, hero, answer } = question;
        let verdict = answer.judge(hit);
        let wrong = matches!(verdict, Verdict::Lost | Verdict::False);
        let self_hit = hit.is_some_and(|hit| match (ray.source, hit.on) {
            (Source::Polygon(own), HitOn::Triangle { triangle, .. }) => triangle.polygon() == own,
            (Source::Curved(own), _) => hit.primitive.0 == own && wrong,
            _ => false,
        });
        let differing = bits(hit) != bits(hero.as_ref()) || occluded != hit.is_some();
        let kernel = &mut self.kernels[which];
        kernel.by_aim[*aim as usize].add(hit, verdict, self_hit, differing);
        let fault = match verdict {
            Verdict::Lost => Fault::Lost,
            Verdict::False => Fault::False,
            _ if self_hit => Fault::SelfHit,
            _ if differing => Fault::Differing,
            _ => return,
        };
        if self.disagreements.len() < TOLD {
            self.disagreements.push(Disagreement {
                kernel: kernel.kernel,
                fault,
                aimed_at: *aim,
                origin: ray.origin,
                direction: ray.direction,
                found: hit.map(|h| (h.t, h.primitive.0)),
                nearest: answer.nearest,
                candidates: answer.ids(),
            });
        }
    }
}

fn bits(hit: Option<&Hit>) -> Option<(u32, u32)> {
    hit.map(|hit| (hit.t.to_bits(), hit.primitive.0))
}

/// Shoots `rays` rays, of all kinds in turn, through every kernel and through the oracle.
pub fn verify(database: &Verified, view: &View, rays: u64, seed: u64) -> Verification {
    let subject = Subject::new(database);
    let mut tracers = subject.tracers();
    let oracle = BruteForce::new(database);
    let mut source = Rays::new(database, view, seed);
    let counts = |kernel| KernelOutcomes { kernel, total: Outcomes::default(), by_aim: Default::default() };
    let mut found = Verification {
        kernels: tracers.iter().map(|tracer| counts(tracer.kernel())).collect(),
        disagreements: Vec::new(),
    };
    let mut aims = AimedAt::ALL.into_iter().cycle();
    let mut surfaces = Vec::new();
    for first in (0..rays).step_by(BATCH as usize) {
        let count = BATCH.min(rays - first) as usize;
        let (aims, rays): (Vec<AimedAt>, Vec<Ray>) =
            aims.by_ref().take(count).map(|aim| aimed(&mut source, aim, &mut surfaces)).unzip();
        let hero = tracers[0].nearest(&rays);
        surfaces.clear();
        surfaces.extend(rays.iter().zip(&hero).filter_map(|(ray, hit)| hit.map(|hit| (*ray, hit))));
        let ask = |((aim, &ray), hero)| Question { aim, ray, hero, answer: oracle.nearest(&ray) };
        let questions: Vec<Question> = aims.into_iter().zip(&rays).zip(hero).map(ask).collect();
        for (which, tracer) in tracers.iter_mut().enumerate() {
            let hits = tracer.nearest(&rays);
            let occluded = tracer.occluded(&rays);
            for ((question, hit), occluded) in questions.iter().zip(hits).zip(occluded) {
                found.add(which, question, hit.as_ref(), occluded);
            }
        }
    }
    for kernel in &mut found.kernels {
        for counts in kernel.by_aim {
            kernel.total.sum(&counts);
        }
    }
    found
}

/// A ray of this kind; where there is none, as from a surface before any was hit, one aimed anywhere.
fn aimed(source: &mut Rays<'_>, aim: AimedAt, surfaces: &mut Vec<(Ray, Hit)>) -> (AimedAt, Ray) {
    let ray = match aim {
        AimedAt::Pixel => source.through_pixel(),
        AimedAt::Anywhere => None,
        AimedAt::AlongAxes => Some(source.along_axes()),
        AimedAt::Edge => Some(source.at_edge()),
        AimedAt::FromSurface => surfaces.pop().map(|(ray, hit)| leaving(&ray, &hit, source)),
    };
    ray.map_or_else(|| (AimedAt::Anywhere, source.anywhere()), |ray| (aim, ray))
}

/// A ray from a hit's surface, to either side of it.
fn leaving(ray: &Ray, hit: &Hit, source: &mut Rays<'_>) -> Ray {
    hit.surface_point(ray).leaving(source.direction(), f32::INFINITY)
}
