//! The image as files: PNG for the eye, NPY for what else was asked of the first hit, EXR for the exact
//! colours, and the hash that says whether two images are the same.

mod exr;
mod frame_buffer;
mod npy;
mod png;

use std::io;
use std::path::{Path, PathBuf};

pub use frame_buffer::{FrameBuffer, FrameBufferError};

use ground::atomic_file;

/// Whether this build writes OpenEXR (cargo feature `exr`).
pub const EXR_SUPPORTED: bool = cfg!(feature = "exr");

impl FrameBuffer {
    /// Writes `NAME.png`, the asked-for `NAME.t.npy`, `NAME.n.npy`, `NAME.prim.npy`, and `NAME.exr`; returns
    /// what was written, the image first. Each file is there whole or not at all.
    ///
    /// # Errors
    /// A file cannot be written, or `exr` is asked of a build without it ([`EXR_SUPPORTED`]).
    pub fn write(&self, image: &Path, exr: bool) -> io::Result<Vec<PathBuf>> {
        let (pixels, aov) = (self.pixels(), self.aov());
        let (width, height) = (self.width() as usize, self.height() as usize);
        let mut written = Vec::new();
        let mut put = |path: PathBuf, writer: &dyn Fn(&mut atomic_file::Writer) -> io::Result<()>| {
            atomic_file::write(&path, writer)?;
            written.push(path);
            io::Result::Ok(())
        };

        put(image.to_owned(), &|file| png::write(file, self))?;
        if aov.depth {
            put(image.with_extension("t.npy"), &|file| npy::write(file, &[height, width], &pixels.depth))?;
        }
        if aov.normal {
            let normals = pixels.normal.as_flattened();
            put(image.with_extension("n.npy"), &|file| npy::write(file, &[height, width, 3], normals))?;
        }
        if aov.primitive {
            put(image.with_extension("prim.npy"), &|file| npy::write(file, &[height, width], &pixels.primitive))?;
        }
        if exr {
            put(image.with_extension("exr"), &|file| exr::write(file, self))?;
        }
        Ok(written)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::AovSet;

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
    fn exr_is_refused_by_a_build_without_it() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let frame = FrameBuffer::new(2, 2, AovSet::default()).expect("a small frame");
        let written = frame.write(&folder.path().join("image.png"), true);
        assert_eq!(written.is_ok(), EXR_SUPPORTED);
    }
}
