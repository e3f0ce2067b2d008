//! `marti verify --watertight`

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, available_parallelism};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::table::{Format, Table};
use super::{Failure, json, print};
use crate::study::page::table::grouped;
use ground::outlet;
use ground::processor_time;
use trace::oracle::{ClosedMesh, Kernel, KernelTracer, Subject};
use trace::tracer::octree::Octree;
use trace::tracer::octree::{BuildParameters, build_database};
use trace::tracer::ray::Ray;

/// Rays that a thread takes at once, all of them in one mesh.
const PORTION: u64 = 1 << 14;

/// Escapes that are reported in full.
const TOLD: usize = 8;

/// Between two lines on standard error.
const LINE_PERIOD: Duration = Duration::from_secs(10);

/// Prints in a format, or neither progress nor a result.
pub(super) fn verify(rays: u64, seed: u64, octree: Octree, format: Option<Format>) -> Result<(), Failure> {
    let report = shoot(rays, seed, octree, format.is_none())?;
    format.map_or(Ok(()), |format| report.print(format))?;
    let escapes: u64 = report.kernels.iter().map(|kernel| kernel.escapes).sum();
    if escapes == 0 { Ok(()) } else { Err(Failure::failed(format!("{escapes} rays escaped"))) }
}

#[derive(Clone, Debug, Serialize)]
struct Report {
    seed: u64,
    threads: usize,
    meshes: Vec<&'static str>,
    kernels: Vec<Tally>,
    /// The first escapes.
    escapes: Vec<Escape>,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Tally {
    kernel: Kernel,
    rays: u64,
    /// Rays from inside that hit nothing.
    escapes: u64,
    /// Processor time of all threads.
    seconds: f64,
}

#[derive(Clone, Debug, Serialize)]
struct Escape {
    kernel: Kernel,
    mesh: &'static str,
    origin: [f32; 3],
    direction: [f32; 3],
}

/// Shoots `rays` rays, dealt out to the kernels, on as many threads as there are processors.
fn shoot(rays: u64, seed: u64, octree: Octree, quiet: bool) -> Result<Report, Failure> {
    let meshes = ClosedMesh::all();
    let parameters = BuildParameters::from(octree);
    let mut databases = Vec::new();
    for mesh in &meshes {
        let database = build_database(&mesh.scene(), parameters);
        databases.push(database.map_err(|error| Failure::failed(format!("{}: {error}", mesh.name)))?);
    }
    let subjects: Vec<Subject<'_>> = databases.iter().map(Subject::new).collect();
    let threads = available_parallelism().map_or(1, usize::from);
    let kernels = Kernel::available().len();
    let tally = |kernel| Tally { kernel, rays: 0, escapes: 0, seconds: 0.0 };
    let report = Mutex::new(Report {
        seed,
        threads,
        meshes: meshes.iter().map(|mesh| mesh.name).collect(),
        kernels: Kernel::available().into_iter().map(tally).collect(),
        escapes: Vec::new(),
    });
    let next = AtomicU64::new(0);
    let progress = Mutex::new(Progress { quiet, start: Instant::now(), next_line: LINE_PERIOD, done: 0 });
    let worker = || {
        let mut tracers: Vec<Vec<KernelTracer<'_>>> = subjects.iter().map(Subject::tracers).collect();
        loop {
            let portion = next.fetch_add(1, Ordering::Relaxed);
            let first = portion.saturating_mul(PORTION);
            if first >= rays {
                return;
            }
            let count = PORTION.min(rays - first);
            let [which, any, kernel] = turn(portion as usize, [meshes.len(), 2, kernels]);
            let (mesh, tracer) = (&meshes[which], &mut tracers[which][kernel]);
            let batch: Vec<Ray> = mesh.rays(seed.wrapping_add(portion)).take(count as usize).collect();
            // Shadow rays must not escape either.
            let (escaped, seconds) = escaped(tracer, &batch, any == 1);
            let mut report = report.lock().expect("no thread panics while it holds the report");
            let tally = &mut report.kernels[kernel];
            tally.rays += count;
            tally.escapes += escaped.len() as u64;
            tally.seconds += seconds;
            let left = TOLD.saturating_sub(report.escapes.len());
            let escape = |ray: Ray| Escape {
                kernel: tracer.kernel(),
                mesh: mesh.name,
                origin: ray.origin,
                direction: ray.direction,
            };
            report.escapes.extend(escaped.into_iter().take(left).map(escape));
            drop(report);
            progress.lock().expect("no thread panics while it holds the progress").add(count, rays);
        }
    };
    thread::scope(|scope| {
        (0..threads).try_for_each(|_| thread::Builder::new().spawn_scoped(scope, worker).map(drop)).inspect_err(|_| {
            // Those that were started find nothing more to do.
            next.store(u64::MAX / 2, Ordering::Relaxed);
        })
    })
    .map_err(|error| Failure::failed(format!("cannot start {threads} threads: {error}")))?;
    Ok(report.into_inner().expect("no thread panicked"))
}

/// The place of a portion in all combinations of so many choices.
fn turn<const N: usize>(portion: usize, choices: [usize; N]) -> [usize; N] {
    let mut rest = portion;
    choices.map(|count| {
        let choice = rest % count;
        rest /= count;
        choice
    })
}

/// The rays that hit nothing, and the processor seconds that it took to know.
fn escaped(tracer: &mut KernelTracer<'_>, rays: &[Ray], any: bool) -> (Vec<Ray>, f64) {
    let start = processor_time::of_this_thread();
    let hits: Vec<bool> =
        if any { tracer.occluded(rays) } else { tracer.nearest(rays).iter().map(Option::is_some).collect() };
    let seconds = processor_time::of_this_thread().saturating_sub(start).as_secs_f64();
    (rays.iter().zip(hits).filter(|(_, hit)| !hit).map(|(ray, _)| *ray).collect(), seconds)
}

struct Progress {
    quiet: bool,
    start: Instant,
    next_line: Duration,
    /// Rays that were traced.
    done: u64,
}

impl Progress {
    fn add(&mut self, count: u64, of: u64) {
        self.done += count;
        let elapsed = self.start.elapsed();
        if self.quiet || elapsed < self.next_line {
            return;
        }
        self.next_line += LINE_PERIOD;
        let left = elapsed.as_secs_f64() * (of - self.done) as f64 / self.done as f64;
        let million = |rays: u64| rays as f64 * 1e-6;
        let (done, of) = (million(self.done), million(of));
        outlet::say(format_args!("{done:.1} of {of:.1} million rays, {left:.0} s left"));
    }
}

/// A tally as a line of a table.
#[derive(Serialize)]
struct Row {
    #[serde(flatten)]
    tally: Tally,
    million_rays_per_second: f64,
}

impl Row {
    fn new(tally: &Tally) -> Self {
        Self { tally: *tally, million_rays_per_second: tally.rays as f64 * 1e-6 / tally.seconds.max(1e-9) }
    }
}

impl Report {
    fn print(&self, format: Format) -> Result<(), Failure> {
        let rows: Vec<Row> = self.kernels.iter().map(Row::new).collect();
        let table = || Table::new(&rows).map(|table| table.print(format, &["kernel"]));
        match format {
            Format::Json => return print(&json(self)?),
            Format::Csv => return print(&table()?),
            Format::Text => {}
        }
        let mut text = format!("meshes {}\nthreads {}, seed {}\n\n", self.meshes.join(", "), self.threads, self.seed);
        text += &table()?;
        let (rays, escapes): (u64, u64) =
            self.kernels.iter().fold((0, 0), |sum, kernel| (sum.0 + kernel.rays, sum.1 + kernel.escapes));
        text += &format!("\n{} rays, {} escapes\n", grouped(rays), grouped(escapes));
        for Escape { kernel, mesh, origin, direction } in &self.escapes {
            text += &format!("{kernel}, {mesh}: from {origin:?} along {direction:?}\n");
        }
        print(&text)
    }
}
