//! Traces in libCacheSim's binary format `oracleGeneral`.

use std::io::{self, BufRead, Read};
use std::path::Path;

use super::imported::{Builder, Imported};
use super::table_lines::Unit;
use crate::replay::exporters::oracle_general::REFERENCE_BYTES;
use trace::scene::SourceError;

/// What a file compressed by zstd begins with. As a time it is in the year 2104.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Reads a trace. Each object is one line, however long lines are, in the set of its number; times, sizes and next
/// accesses are not used. References to objects of size 0 are left out, as libCacheSim leaves them out, and counted.
///
/// # Errors
/// The byte where something is wrong, and what was expected.
pub fn read(file: &Path, mut input: impl BufRead) -> Result<Imported, SourceError> {
    let whole = |what: String| SourceError::new(file, None, what);
    let mut builder = Builder::new(Unit::Objects).map_err(whole)?;
    let mut reference = [0; REFERENCE_BYTES as usize];
    let mut at = 0;
    loop {
        let length = read_up_to(&mut input, &mut reference).map_err(|error| whole(format!("byte {at}: {error}")))?;
        if at == 0 && reference[..length].starts_with(&ZSTD) {
            return Err(whole(
                "byte 0: compressed by zstd, expected plain oracleGeneral: `zstd -d` it first".to_owned(),
            ));
        }
        if length == 0 {
            return builder.finish().map_err(whole);
        }
        if length < reference.len() {
            let what = format!("byte {at}: {length} bytes of a reference, expected {REFERENCE_BYTES}");
            return Err(whole(what));
        }
        let id: u64 = bytemuck::pod_read_unaligned(&reference[4..12]);
        let size: u32 = bytemuck::pod_read_unaligned(&reference[12..16]);
        if size == 0 {
            builder.left_out += 1;
        } else {
            builder.reference(id, 1).map_err(|what| whole(format!("byte {at}: {what}")))?;
        }
        at += REFERENCE_BYTES;
    }
}

/// Fills the buffer as far as the input goes.
fn read_up_to(input: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match input.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}
