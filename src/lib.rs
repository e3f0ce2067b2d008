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
//! // The same bits on any number of threads, and on any host.
//! let again = Renderer::new(&database).threads(1).render(&view)?;
//! assert_eq!(again.frame.sha256(), rendering.frame.sha256());
//! # Ok::<(), Box<dyn std::error::Error>>(())
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
//!     let mut node = Replayer::<Lru, _>::new(&lines, Geometry::new(&memory, layout).expect("not too small"), 1);
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

pub use cluster::topology::Topology;
pub use cluster::topology::recorded::open_references;
pub use trace::database::verify::Verified;
pub use trace::picture::{AovSet, ImageSettings};
pub use trace::preparation::{CameraChoices, ImageDefaults, ViewChoices, view};
pub use trace::render::{Renderer, Rendering};
pub use trace::scene::{Camera, Light, Scene, SceneSource, UpAxis, Warning};
pub use trace::tracer::View;
pub use trace::tracer::octree::{Octree, build_database};

/// Pictures: their settings, tilings and pixels.
pub mod picture {
    pub use trace::picture::*;
}

/// Memories, buses and arbiters, as they are asked for and as they are simulated.
pub mod machine {
    pub use ::machine::hardware::{arbiter, bus, local_memory, replacement, specification};
}

/// References replayed through other memories and buses.
pub mod replay {
    pub use ::machine::replay::*;
}

/// A whole cluster in one process and in virtual time: the state machines of the real processes, and real memories and tracers.
#[cfg(feature = "testing")]
pub mod simulation {
    pub use cluster::processes::simulation::*;
}
