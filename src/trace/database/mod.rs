//! A scene as one flat, relocatable image in cluster memory: sections of fixed-size records.
//!
//! The records are in [`records`], where each lies in [`layout`], making them from a scene in
//! [`compile`]. The octree's sections come from `tracer::octree::build`.

pub mod compile;
pub mod ear_clipping;
pub mod layout;
pub mod normalisation;
pub mod primitives;
pub mod record_layout;
pub mod records;
pub mod section;
pub mod strides;
pub mod verify;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use layout::Layout;
pub use normalisation::Normalisation;
pub use record_layout::{Numbers, Objects, RecordLayout};
pub use section::Section;

/// What every process must know of a database besides its bytes. Small: it travels with the job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    pub layout: Layout,
    pub normalisation: Normalisation,
    /// Deepest level that a branch of the octree may be on; the root is level 0.
    pub max_depth: u32,
    /// Polygons, spheres and cones as in the file.
    pub scene_primitives: u64,
    /// Whether a material lets a light's rays pass.
    pub has_sheets: bool,
}

/// A whole database: the header and the image, 32-bit little-endian words.
#[derive(Clone, Debug)]
pub struct Database {
    pub header: Header,
    pub words: Arc<Vec<u32>>,
}

impl Database {
    /// The image as cluster memory holds it.
    pub fn bytes(&self) -> &[u8] {
        bytemuck::cast_slice(&self.words)
    }

    /// The records of a section, of the type that [`records`] names for it.
    ///
    /// # Panics
    /// The image is shorter than its layout says ([`verify::Verified`] has checked it), `T` is another section's type, or the
    /// records are padded ([`Self::unpadded`] has them without).
    pub fn records<T: bytemuck::Pod>(&self, section: Section) -> &[T] {
        assert_eq!(size_of::<T>() as u64, self.header.layout.record_bytes(section), "record type of {section:?}");
        let first = (self.header.layout.span(section).base.0 / 4) as usize;
        let words = (self.header.layout.section_bytes(section) / 4) as usize;
        bytemuck::cast_slice(&self.words[first..first + words])
    }

    /// The same records side by side: this database itself where no record is padded.
    ///
    /// # Panics
    /// The image is shorter than its layout says.
    #[must_use]
    pub fn unpadded(&self) -> Self {
        let layout = self.header.layout.unpadded();
        if layout == self.header.layout {
            return self.clone();
        }
        let mut words = vec![0; (layout.database_bytes() / 4) as usize];
        for section in Section::ALL {
            let from = (self.header.layout.span(section).base.0 / 4) as usize;
            let padded = &self.words[from..from + (self.header.layout.section_bytes(section) / 4) as usize];
            let to = (layout.span(section).base.0 / 4) as usize;
            let (content, stride) = (layout.record_bytes(section), self.header.layout.record_bytes(section));
            let records = words[to..].chunks_exact_mut(content as usize / 4);
            for (record, padded) in records.zip(padded.chunks_exact(stride as usize / 4)) {
                record.copy_from_slice(&padded[..record.len()]);
            }
        }
        Self { header: Header { layout, ..self.header.clone() }, words: Arc::new(words) }
    }
}
