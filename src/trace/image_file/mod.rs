//! The image as files: PNG for the eye, NPY for what else was asked of the first hit, EXR for the exact
//! colours, and the hash that says whether two images are the same; by how much two pictures differ.

mod comparison;
mod exr;
mod frame_buffer;
mod npy;
mod png;

use std::io;
use std::path::{Path, PathBuf};

pub use comparison::{Comparison, Picture, SizesDiffer};
pub use frame_buffer::{FrameBuffer, FrameBufferError};

use crate::picture::AovSet;
use ground::atomic_file;

/// Whether this build writes OpenEXR (cargo feature `exr`).
pub const EXR_SUPPORTED: bool = cfg!(feature = "exr");

/// One of the files of an image.
#[derive(Clone, Copy)]
enum Part {
    Png,
    Depth,
    Normal,
    Primitive,
    Exr,
}

impl Part {
    /// The image first.
    fn all(aov: AovSet, exr: bool) -> impl Iterator<Item = Self> {
        let asked = [aov.depth, aov.normal, aov.primitive, exr].into_iter();
        let parts = [Self::Depth, Self::Normal, Self::Primitive, Self::Exr].into_iter().zip(asked);
        std::iter::once(Self::Png).chain(parts.filter_map(|(part, is_asked)| is_asked.then_some(part)))
    }

    fn path(self, image: &Path) -> PathBuf {
        match self {
            Self::Png => image.to_owned(),
            Self::Depth => image.with_extension("t.npy"),
            Self::Normal => image.with_extension("n.npy"),
            Self::Primitive => image.with_extension("prim.npy"),
            Self::Exr => image.with_extension("exr"),
        }
    }
}

/// The files that [`FrameBuffer::write`] writes, the image first: `NAME.png`, the asked-for `NAME.t.npy`, `NAME.n.npy`,
/// `NAME.prim.npy`, and `NAME.exr`.
pub fn files(image: &Path, aov: AovSet, exr: bool) -> Vec<PathBuf> {
    Part::all(aov, exr).map(|part| part.path(image)).collect()
}

impl FrameBuffer {
    /// Writes the image as PNG, the planes that it has beside it and, if `exr`, also its exact colours as OpenEXR; returns their
    /// [`files`]. Each file is there whole or not at all.
    ///
    /// # Errors
    /// `image` does not end in `.png`, a file cannot be written, or `exr` is asked of a build without it ([`EXR_SUPPORTED`]).
    pub fn write(&self, image: &Path, exr: bool) -> io::Result<Vec<PathBuf>> {
        if !image.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
            let what = format!("{}: expected a name ending in .png", image.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        }
        let pixels = self.pixels();
        let (width, height) = (self.width() as usize, self.height() as usize);
        for part in Part::all(self.aov(), exr) {
            atomic_file::write(&part.path(image), |file| match part {
                Part::Png => png::write(file, self),
                Part::Depth => npy::write(file, &[height, width], &pixels.depth),
                Part::Normal => npy::write(file, &[height, width, 3], pixels.normal.as_flattened()),
                Part::Primitive => npy::write(file, &[height, width], &pixels.primitive),
                Part::Exr => exr::write(file, self),
            })?;
        }
        Ok(files(image, self.aov(), exr))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_asked_for_file_is_written_under_the_same_stem() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let aov = AovSet { depth: true, normal: true, primitive: true };
        let frame = FrameBuffer::new(5, 3, aov).expect("a small frame");
        let written = frame.write(&folder.path().join("a.b.png"), false).expect("writable folder");
        let names: Vec<_> = written.iter().filter_map(|path| path.file_name()?.to_str()).collect();
        assert_eq!(names, ["a.b.png", "a.b.t.npy", "a.b.n.npy", "a.b.prim.npy"]);
        // 128 bytes of header, then the plane.
        let size = |name: &str| std::fs::metadata(folder.path().join(name)).expect("written").len();
        assert_eq!(
            [size("a.b.t.npy"), size("a.b.n.npy"), size("a.b.prim.npy")],
            [128 + 15 * 4, 128 + 15 * 12, 128 + 15 * 4]
        );
    }

    #[test]
    fn a_name_of_another_format_is_refused() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let frame = FrameBuffer::new(2, 2, AovSet::default()).expect("a small frame");
        for name in ["x.jpg", "x", ".png", "x.png.exr"] {
            let error = frame.write(&folder.path().join(name), false).expect_err(name);
            assert!(error.to_string().ends_with(&format!("{name}: expected a name ending in .png")), "{error}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
        frame.write(&folder.path().join("x.PNG"), false).expect("a writable folder");
    }

    #[test]
    fn exr_is_refused_by_a_build_without_it() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let frame = FrameBuffer::new(2, 2, AovSet::default()).expect("a small frame");
        let written = frame.write(&folder.path().join("image.png"), true);
        assert_eq!(written.is_ok(), EXR_SUPPORTED);
    }
}
