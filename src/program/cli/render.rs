//! `marti render SCENE`

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum, value_parser};
use nix::sys::signal::Signal;

use super::options::{ImageSize, OctreeOptions, OutputOptions, Switch, TextOrJson, png_path};
use super::report::print_report;
use super::view_options::ViewOptions;
use super::{Exit, Failure, output_path, subject};
use cluster::processes::scene_warnings;
use cluster::report::{self, Report, SCHEMA_VERSION, Seconds, json};
use cluster::topology::value::{Cutoff, Depth};
use cluster::topology::{self, Topology};
use ground::interruption::Interruption;
use ground::progress::{Progress, Status};
use trace::image_file;
use trace::preparation::{self, ImageDefaults, Prepared};
use trace::render::{self, Kernel, Rendering, Settings};
use trace::scene::SceneSource;
use trace::tracer::bvh8::Bvh8;
use trace::tracer::octree::Octree;
use trace::tracer::octree::census::Census;
use trace::tracer::simd::Simd;

/// Render a scene in this one process: the fastest way on one machine
#[derive(Clone, Debug, Args)]
pub struct RenderArguments {
    /// An .nff or .obj file, or gears, teapot, balls, tetra, slivers, plane, decades, giant, corner, also with a size as in gears:2;
    /// or a topology file: its scene, view and image, but for what is given here
    pub scene: SceneSource,
    /// Image to write, into a folder that exists [default: the name of the scene, or of the topology, with .png]
    #[arg(long, short, alias = "output", value_name = "NAME.png", value_parser = png_path)]
    out: Option<PathBuf>,
    /// Pixels of the image [default: the scene file's resolution, else 512x512]
    #[arg(long, value_name = "WxH")]
    pub size: Option<ImageSize>,
    /// Number of threads [default: all processors]
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Render so many times; the seconds reported are medians
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = value_parser!(u32).range(1..=1000))]
    pub repeat: u32,
    /// How many reflections or refractions may follow one another [default: 4, or the topology's]
    #[arg(long, value_name = "N")]
    pub depth: Option<Depth>,
    /// A reflected or refracted ray is cast when its weight in the pixel exceeds this [default: 0, or the topology's]
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub cutoff: Option<Cutoff>,
    #[command(flatten)]
    view: ViewOptions,
    #[command(flatten)]
    octree: OctreeOptions,
    /// Test a primitive that is in many leaves only once per ray [default: on, or the topology's]
    #[arg(long, value_enum, value_name = "on|off", hide_possible_values = true)]
    mailbox: Option<Switch>,
    /// What traces; the image is the same
    #[arg(long, value_enum, value_name = "packets|single", hide_possible_values = true, default_value_t = KernelName::Packets)]
    kernel: KernelName,
    /// Vector instructions of the packets [default: the most that this processor has]
    #[arg(long, value_name = "scalar|sse2|avx2|avx512")]
    simd: Option<Simd>,
    #[command(flatten)]
    pub planes: OutputOptions,
    /// How the summary is printed; as JSON it is the whole report (docs/report.md)
    #[arg(long, value_enum, default_value_t = TextOrJson::Text, conflicts_with = "quiet")]
    format: TextOrJson,
    /// Print no progress and no summary
    #[arg(long, short)]
    quiet: bool,
    /// Also write a report as JSON (docs/report.md)
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    /// Warnings about the scene are errors: nothing is rendered
    #[arg(long)]
    strict: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum KernelName {
    Packets,
    Single,
}

impl RenderArguments {
    /// The topology's settings, or those of a scene alone, with the options in their place.
    fn subject(&self) -> Result<Topology, Failure> {
        let topology = match &self.scene {
            SceneSource::File(path) if subject::is_topology(path) => Topology::read(path, &[])?,
            scene => Topology::of_scene(scene, &[])?,
        };
        let octree = self.octree.octree(topology.octree);
        let image = topology.image;
        Ok(Topology {
            view: self.view.choices().or(topology.view),
            image: topology::Image {
                width: self.size.map(|size| size.width).or(image.width),
                height: self.size.map(|size| size.height).or(image.height),
                depth: self.depth.map_or(image.depth, |Depth(depth)| depth),
                cutoff: self.cutoff.map_or(image.cutoff, |Cutoff(cutoff)| cutoff),
                terminator: self.view.terminator.or(image.terminator),
                ..image
            },
            octree: Octree { mailbox: self.mailbox.map_or(octree.mailbox, |switch| switch == Switch::On), ..octree },
            ..topology
        })
    }

    fn threads(&self) -> usize {
        self.threads.map_or_else(|| available_parallelism().map_or(1, usize::from), |threads| threads as usize)
    }

    /// What is written, each with the option that asks for it.
    fn outputs<'a>(&'a self, image: &'a [PathBuf]) -> Vec<(&'static str, &'a Path)> {
        let image = image.iter().map(|file| ("-o", file.as_path()));
        image.chain(self.report.as_deref().map(|report| ("--report", report))).collect()
    }

    /// The files that are known to be read before the scene is.
    fn inputs<'a>(&'a self, subject: &'a Topology) -> Vec<&'a Path> {
        let files = [&self.scene, &subject.scene].map(|scene| match scene {
            SceneSource::File(file) => Some(file.as_path()),
            SceneSource::Procedural(_) => None,
        });
        files.into_iter().flatten().collect()
    }

    /// The image to write.
    fn image(&self, topology: &Topology) -> PathBuf {
        let name = || match &self.scene {
            SceneSource::File(path) if subject::is_topology(path) => topology.name.clone(),
            scene => scene.name(),
        };
        self.out.clone().unwrap_or_else(|| PathBuf::from(name() + ".png"))
    }
}

pub(super) fn render(arguments: &RenderArguments) -> Result<(), Failure> {
    let start = Instant::now();
    let packets = arguments.kernel == KernelName::Packets;
    if !packets && arguments.simd.is_some() {
        return Err(Failure::bad_input("--simd is of packets, but --kernel is single"));
    }
    if packets && arguments.mailbox.is_some() {
        return Err(Failure::bad_input("--mailbox is of the single kernel, but --kernel is packets"));
    }
    let (aov, exr) = (arguments.planes.aov(), arguments.planes.exr());
    let subject = arguments.subject()?;
    let image = arguments.image(&subject);
    let files = image_file::files(&image, aov, exr);
    let outputs = arguments.outputs(&files);
    output_path::check_apart(&outputs, &arguments.inputs(&subject))?;
    outputs.iter().try_for_each(|(_, file)| output_path::check(file))?;
    // One process has no tiles that could be too large.
    let settings = |defaults: &ImageDefaults| subject.image.settings(defaults);
    let prepared = preparation::prepare(&subject.scene, subject.build_choices(), &subject.view, settings)?;
    output_path::check_apart(&outputs, &prepared.libraries.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    scene_warnings::show(&prepared.warnings);
    if arguments.strict && prepared.warnings.iter().any(preparation::is_certain) {
        return Err(Failure::of_warnings());
    }
    let derivation = Instant::now();
    let derived = packets.then(|| Bvh8::build(&prepared.database));
    let derivation = derivation.elapsed();
    let kernel = match &derived {
        Some(derived) => Kernel::Packets(derived, arguments.simd.unwrap_or_else(Simd::best)),
        None => Kernel::Single { mailbox: subject.octree.mailbox },
    };
    let settings = Settings { threads: arguments.threads(), aov, kernel };
    let interruption =
        Interruption::watch().map_err(|error| Failure::failed(format!("cannot heed signals: {error}")))?;
    let Measured { rendering, walls, cpus } = arguments.measure(&prepared, settings, &interruption)?;
    let files = rendering.frame.write(&image, exr).map_err(|error| Failure::failed(error.to_string()))?;
    let seconds = Seconds {
        load: prepared.load.as_secs_f64(),
        octree: (prepared.build + derivation).as_secs_f64(),
        render: median(walls),
        render_cpu: median(cpus),
        total: start.elapsed().as_secs_f64(),
    };
    let report = report(subject.scene.to_string(), &prepared, kernel, &rendering, files, seconds);
    if let Some(path) = &arguments.report {
        json::write(&report, path).map_err(|error| Failure::failed(error.to_string()))?;
    }
    let printed = if arguments.quiet { Ok(()) } else { print_report(&report, arguments.format) };
    match interruption.signal() {
        None => printed,
        Some(signal) => Err(interrupted(signal, &rendering, &image)),
    }
}

/// A rendering, and the seconds of each time that it was made.
struct Measured {
    rendering: Rendering,
    walls: Vec<Duration>,
    cpus: Vec<Duration>,
}

impl RenderArguments {
    /// Renders as often as is asked, until a signal comes: what was complete before counts, else what there is.
    fn measure(
        &self,
        prepared: &Prepared,
        settings: Settings<'_>,
        interruption: &Interruption,
    ) -> Result<Measured, Failure> {
        let once = || {
            let progress = Mutex::new(Progress::new(self.quiet, render::tile_count(&prepared.view.image)));
            let show = |status: &Status| {
                // One thread that shows is enough; the others go on tracing.
                if let Ok(mut progress) = progress.try_lock() {
                    progress.show(status);
                }
                if interruption.signal().is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            let rendering = render::render(&prepared.database, &prepared.view, settings, show);
            progress.into_inner().unwrap_or(Progress::Quiet).clear();
            rendering.map_err(|error| Failure::failed(error.to_string()))
        };
        let rendering = once()?;
        let (walls, cpus) = (vec![rendering.wall], vec![rendering.cpu]);
        let mut measured = Measured { rendering, walls, cpus };
        for _ in 1..self.repeat {
            let rendering = if interruption.signal().is_none() { once()? } else { break };
            if rendering.is_complete() {
                measured.walls.push(rendering.wall);
                measured.cpus.push(rendering.cpu);
                measured.rendering = rendering;
            }
        }
        Ok(measured)
    }
}

/// What is kept of a rendering that a signal has ended.
fn interrupted(signal: Signal, rendering: &Rendering, image: &Path) -> Failure {
    let (exit, what) = match signal {
        Signal::SIGTERM => (Exit::Terminated, "terminated"),
        Signal::SIGHUP => (Exit::HungUp, "the terminal was closed"),
        _ => (Exit::Interrupted, "interrupted"),
    };
    let Rendering { tiles_done, tiles, .. } = rendering;
    Failure::new(exit, format!("{what}; {} has {tiles_done} of {tiles} tiles", image.display()))
}

fn report(
    source: String,
    prepared: &Prepared,
    kernel: Kernel<'_>,
    rendering: &Rendering,
    files: Vec<PathBuf>,
    seconds: Seconds,
) -> Report {
    let stats = &rendering.stats;
    let octree = report::Octree::new(&Census::of(&prepared.database));
    let (kernel, octree, tests) = match kernel {
        Kernel::Single { .. } => (report::Kernel::Single, octree.with_accesses(stats), Some(report::Tests::new(stats))),
        Kernel::Packets(derived, simd) => {
            (report::Kernel::Packets { simd, derived_bytes: derived.bytes() }, octree, None)
        }
    };
    Report {
        schema_version: SCHEMA_VERSION,
        build: env!("CARGO_PKG_VERSION").to_owned(),
        status: if rendering.is_complete() { report::Status::Done } else { report::Status::Interrupted },
        error: None,
        scene: report::Scene::new(source, prepared),
        camera: Some(prepared.into()),
        image: report::Image {
            width: rendering.frame.width(),
            height: rendering.frame.height(),
            sha256: Some(rendering.frame.sha256()),
            non_finite_pixels: stats.non_finite_pixels,
            unverified: None,
            files,
            file_sha256: None,
        },
        kernel: Some(kernel),
        rays: report::Rays::new(stats),
        octree,
        tests,
        tiles: None,
        nodes: Vec::new(),
        memory: None,
        bus: None,
        conservation: None,
        verification: None,
        chaos: None,
        incidents: Vec::new(),
        warnings: prepared.warnings.clone(),
        seconds,
    }
}

/// The middle one, in seconds; of an even number, the mean of the two in the middle.
fn median(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    let (lower, upper) = (times[(times.len() - 1) / 2], times[times.len() / 2]);
    (lower + upper).as_secs_f64() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_in_the_middle() {
        let seconds = |of: &[u64]| median(of.iter().map(|s| Duration::from_secs(*s)).collect());
        assert_eq!((seconds(&[7]), seconds(&[9, 1, 2]), seconds(&[4, 1, 2, 9])), (7.0, 2.0, 3.0));
    }
}
