//! What a process that was killed while it wrote leaves at the end of its file: a part of a frame.
//!
//! No accepted tile is in it, as a tile's rows are handed to the operating system before its end is reported.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use super::reader::Recording;
use super::scan::LIMITS;
use crate::recording::frames::{FrameFault, Frames};
use ground::regular_file;

/// Cuts torn tails off the files of a folder that no process writes any more; a file without its first frame is
/// removed. Whatever else is wrong with a file stays.
///
/// # Errors
/// The folder or a file in it cannot be read or cut; the text names it.
pub fn cut_torn_tails(folder: &Path) -> Result<(), String> {
    let names = Recording::file_names(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    for (.., name) in names {
        let path = folder.join(name);
        cut(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    Ok(())
}

fn cut(path: &Path) -> io::Result<()> {
    let file = regular_file::edit(path)?;
    match sound_bytes(&file)? {
        Some(0) => fs::remove_file(path),
        Some(bytes) => file.set_len(bytes),
        None => Ok(()),
    }
}

/// Bytes before the torn tail; `None` when there is none.
fn sound_bytes(file: &File) -> io::Result<Option<u64>> {
    let mut frames = Frames::new(file, LIMITS.frame).map_err(io::Error::other)?;
    loop {
        match frames.next_frame() {
            Ok(Some(_)) => {}
            Ok(None) => return Ok((frames.offset() == 0).then_some(0)),
            Err(error) if matches!(error.fault, FrameFault::Cut { .. }) => return Ok(Some(frames.offset())),
            Err(_) => return Ok(None),
        }
    }
}
