//! marti: a multiprocessor architecture for ray tracing images, for real.
//!
//! A ray tracer whose nodes need not have the whole scene, and a simulator of the memories and the bus that feed them. After
//! M-P. Hébert, M. D. J. McNeill, B. Shah, R. L. Grimsdale, P. F. Lister, *MARTI, a Multiprocessor Architecture for Ray
//! Tracing Images*, 1991.
//!
//! # A scene to an image
//!
//! A [`SceneSource`] is a file or a procedural scene. Its [`Scene`] becomes a [`Database`](Verified), a flat image with its
//! octree; its camera and lights, or those of [`ViewChoices`], with [`ImageSettings`], become a [`View`]. A [`Renderer`] renders
//! views of a database.
//!
//! ```
//! use marti::{ViewChoices, ImageSettings, Octree, Renderer, SceneSource, build_database, view};
//!
//! let scene = "teapot:2".parse::<SceneSource>()?.load()?;
//! let settings = ImageSettings::new(32, 32, 4, 0.0)?;
//! let view = view(&scene, &ViewChoices::default(), |_defaults| Ok(settings))?;
//! let database = build_database(&scene, Octree::DEFAULT.into())?;
//! let rendering = Renderer::new(&database).render(&view)?;
//! assert_eq!(rendering.frame.pixels().colour.len(), 32 * 32);
//! # let folder = tempfile::tempdir()?;
//! # let folder = folder.path();
//! // A PNG file; `true` would also write the exact colours as OpenEXR, where the feature `exr` is on.
//! rendering.frame.write(&folder.join("teapot.png"), false)?;
//! // The same bits on any number of threads, and on any host.
//! let again = Renderer::new(&database).threads(1).render(&view)?;
//! assert_eq!(again.frame.sha256(), rendering.frame.sha256());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A scene can also be made in the program, of what is in [`scene`] and of vectors of [`glam`]:
//!
//! ```
//! use marti::glam::DVec3;
//! use marti::scene::{Material, Sphere};
//! use marti::{Octree, Scene, build_database};
//!
//! let ball = Sphere { centre: DVec3::ZERO, radius: 1.0, material: 0 };
//! let scene = Scene { materials: vec![Material::WHITE], spheres: vec![ball], ..Scene::default() };
//! let database = build_database(&scene, Octree::DEFAULT.into())?;
//! assert_eq!(database.database().header.scene_primitives, 1);
//! # Ok::<(), marti::tracer::BuildError>(())
//! ```
//!
//! # References to other memories
//!
//! [`replay::Captured`] traces an image and keeps every record that was read. Its references are replayed through memories that
//! differ in size, line, ways and replacement, through the very [`Directory`](machine::local_memory::Directory) that decides
//! the hits of a live node; [`open_references`] reads those that a run has recorded.
//!
//! ```
//! use marti::machine::specification::{LocalMemory, MemorySize, Replacement};
//! use marti::machine::{local_memory::Geometry, replacement::Lru};
//! use marti::picture::{Sides, Tiling};
//! use marti::replay::replayer::{Replayer, Sum};
//! use marti::replay::{Captured, RecordLines};
//! # use marti::{ViewChoices, ImageSettings, Octree, SceneSource, build_database, view};
//! # let scene = "teapot:2".parse::<SceneSource>()?.load()?;
//! # let settings = ImageSettings::new(32, 32, 4, 0.0)?;
//! # let view = view(&scene, &ViewChoices::default(), |_defaults| Ok(settings))?;
//! # let database = build_database(&scene, Octree::DEFAULT.into())?;
//!
//! let tiling = Tiling::try_from(Sides { width: 32, height: 32, tile_width: 8, tile_height: 8 })?;
//! let trace = Captured::capture(&database, &view, tiling, true, 1);
//! let layout = &database.database().header.layout;
//! let lines = RecordLines::new(layout, 64);
//! let misses = |size| {
//!     let memory = LocalMemory { size, line: 64, ways: None, replacement: Replacement::Lru };
//!     let mut node = Replayer::<Lru, _>::new(&lines, Geometry::new(&memory, layout).expect("not too small"), 1).expect("few slots");
//!     let mut sum = Sum::new(&trace);
//!     for tile in 0..trace.tiles.len() as u32 {
//!         node.tile(&trace, tile, &mut sum).expect("it is in memory");
//!     }
//!     sum.finish().line_misses
//! };
//! // Inclusion: what hits in a smaller LRU memory hits in a larger one.
//! assert!(misses("1/8".parse::<MemorySize>()?) >= misses("1/2".parse()?));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! `examples/` has these as programs, a replacement policy of one's own, and, with the feature `testing`, a whole cluster in one
//! process and in virtual time. ARCHITECTURE.md has the code map.

#![deny(missing_docs)]

#[cfg(target_endian = "big")]
compile_error!("the database image, the wire format and the hashes of marti are little-endian");

pub use glam;

pub use cluster::topology::Topology;
pub use cluster::topology::recorded::open_references;
pub use trace::database::verify::Verified;
pub use trace::picture::{AovSet, ImageSettings};
pub use trace::preparation::{CameraChoices, ImageDefaults, ViewChoices, view};
pub use trace::render::{RenderError, Renderer, Rendering};
pub use trace::scene::{Scene, SceneSource};
pub use trace::tracer::View;
pub use trace::tracer::octree::{Octree, build_database};

/// Newtypes of what is counted: nodes, tiles, attempts and so on.
pub mod ids {
    pub use ground::ids::{Address, Attempt, ClusterId, Epoch, NodeId, Producer, RunId, TileId};
}

/// Pictures: their settings, tilings and pixels.
pub mod picture {
    pub use trace::picture::{ImageSettingsError, Pixels, Rect, Sides, Terminator, Tiling, TilingError};
}

/// What a [`Scene`] is made of, and where it comes from.
pub mod scene {
    pub use trace::scene::placement::Unplaceable;
    pub use trace::scene::procedural::{Board, BoardError, Kind, KindError, Procedural, SizeError};
    pub use trace::scene::{
        Camera, Cone, Light, Material, Placement, Polygon, SourceError, Sphere, UpAxis, Warning, Warnings, load,
    };
}

/// A scene as the flat memory that nodes read: its header, and where the records of each kind are.
pub mod database {
    pub use trace::database::compile::CompileError;
    pub use trace::database::layout::{Span, TooLarge};
    pub use trace::database::verify::Corrupt;
    pub use trace::database::{Database, Header, Layout, Normalisation, Section};
}

/// What the octree is built with, what the tracer reads through, and what it counts.
pub mod tracer {
    pub use trace::tracer::octree::{BuildError, BuildParameters};
    pub use trace::tracer::{MemoryPort, RayKind, TraceStats};
}

/// The pixels of a whole image, and the files that they are written to.
pub mod image_file {
    pub use trace::image_file::{EXR_SUPPORTED, FrameBuffer, FrameBufferError, files};
}

/// A scene that was read, with its view and its database, as a [`Topology`] prepares it.
pub mod preparation {
    pub use trace::preparation::{PreparationError, Prepared};
}

/// Memories, buses and arbiters, as they are asked for and as they are simulated; what they count.
pub mod machine {
    pub use ::machine::hardware::{
        arbiter, bus, local_memory, references, replacement, specification, stats, transaction,
    };
}

/// In which order tiles are handed out, and to which nodes.
pub mod tile_order {
    pub use ::machine::tile_order::{Assignment, TileOrder, tiles};
}

/// Recorded references, as [`open_references`] gives them.
pub mod recording {
    pub use ::machine::recording::references::{Conditions, LostTile, OpenError, Opened, Recording};
}

/// References replayed through other memories and buses.
pub mod replay {
    pub use ::machine::replay::{
        Captured, Lines, RecordLines, Tally, Trace, TraceError, TracedTile, contention, evaluation, exporters,
        importers, origin, parallel, replayer, setting,
    };

    /// Which node traces which tile, and several settings at once.
    pub mod plan {
        pub use ::machine::replay::plan::{grid, schedule};
    }

    /// What local memories would have counted, besides [`evaluation`] and [`replayer`].
    pub mod model {
        pub use ::machine::replay::model::{
            counts, curve, detail, live, miss_classes, next_use, node, optimal, recount, stack_distance,
        };
    }

    /// What is replayed.
    pub mod stream {
        pub use ::machine::replay::stream::{lines::Spans, reads, subject};
    }
}

/// What a [`Topology`] is made of.
pub mod topology {
    pub use cluster::topology::{Deadlines, Host, Image, Launch, Override, Placement, Run};
}

/// A whole cluster in one process and in virtual time: the state machines of the real processes, and real memories and tracers.
#[cfg(feature = "testing")]
pub mod simulation {
    pub use cluster::processes::simulation::*;
    pub use cluster::protocol::hello::Role;
    pub use cluster::report::{Bus, Node};
}
