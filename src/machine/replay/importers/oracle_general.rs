//! Traces in libCacheSim's binary format `oracleGeneral`.

use std::io::BufRead;
use std::path::Path;

use super::access::{AccessKind, ObjectId};
use super::binary_file::BinaryFile;
use super::builder::Builder;
use super::imported::Imported;
use crate::replay::exporters::oracle_general::REFERENCE_BYTES;
use trace::scene::SourceError;

/// Reads a trace of objects with their sizes; times and next accesses are not used. References to objects of size 0 are left
/// out, as libCacheSim leaves them out, and counted.
///
/// # Errors
/// The byte where something is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut records = BinaryFile::new(file, input);
    let mut builder = Builder::of_objects().map_err(|what| records.whole(what))?;
    let mut record = [0; REFERENCE_BYTES as usize];
    while records.next_record(&mut record)? {
        let id: u64 = bytemuck::pod_read_unaligned(&record[4..12]);
        let size: u32 = bytemuck::pod_read_unaligned(&record[12..16]);
        let read = builder.object(AccessKind::Read, ObjectId::Number(id), u64::from(size));
        read.map_err(|what| records.error(what))?;
    }
    builder.finish(line_bytes).map_err(|what| records.whole(what))
}

/// Whether this is certainly the beginning of such a trace: of eight references or more, times do not fall, and each next
/// access comes later than the reference itself.
pub(super) fn is_beginning(prefix: &[u8]) -> bool {
    const CERTAIN: usize = 8;
    const NONE: [i64; 2] = [-1, i64::MAX];
    let records = prefix.chunks_exact(REFERENCE_BYTES as usize);
    let (count, mut time) = (records.len(), 0);
    let is_possible = |(number, record): (i64, &[u8])| {
        let next: i64 = bytemuck::pod_read_unaligned(&record[16..24]);
        let before = std::mem::replace(&mut time, bytemuck::pod_read_unaligned::<u32>(&record[..4]));
        before <= time && (NONE.contains(&next) || (number..1 << 48).contains(&next))
    };
    count >= CERTAIN && (1i64..).zip(records).all(is_possible)
}
