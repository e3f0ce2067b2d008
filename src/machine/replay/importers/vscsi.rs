//! Traces of virtual disks in VMware's binary format `vscsi`, versions 1 and 2, as libCacheSim reads them (its `vscsi.h`).

use std::io::BufRead;
use std::path::Path;

use super::access::{AccessKind, ObjectId};
use super::binary_file::BinaryFile;
use super::builder::Builder;
use super::imported::Imported;
use trace::scene::SourceError;

/// A version of the format: where its fields are. All are little-endian.
#[derive(Clone, Copy, Debug)]
struct Version {
    number: u8,
    record_bytes: usize,
    /// u16, the SCSI command.
    command: usize,
    /// u16, the version in its upper byte.
    version: usize,
    /// u32, in bytes.
    length: usize,
    /// u64, a logical block number.
    block: usize,
}

/// u32 number, u32 length, u32 segments, u16 command, u16 version, u64 block, u64 time.
const VERSION_1: Version = Version { number: 1, record_bytes: 32, command: 12, version: 14, length: 4, block: 16 };
/// u16 command, u16 version, u32 number, u32 length, u32 segments, u64 block, u64 time, u64 response time.
const VERSION_2: Version = Version { number: 2, record_bytes: 40, command: 0, version: 2, length: 8, block: 16 };

/// Reads a trace: each first block is an object that has the size of the request, as in libCacheSim. Commands that write are
/// writes; times are not used, and requests of no bytes are left out and counted.
///
/// # Errors
/// The byte where something is wrong, and what was expected.
pub fn read(file: &Path, mut input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let whole = |what: String| SourceError::new(file, None, what);
    // The version comes before the end of the shorter record.
    let first = input.fill_buf().map_err(|error| whole(error.to_string()))?;
    let version = [VERSION_2, VERSION_1].into_iter().find(|version| version.is_of(first));
    let version =
        version.ok_or_else(|| whole("byte 0: neither version 1 nor 2 of vscsi, expected either".to_owned()))?;
    let mut records = BinaryFile::new(file, input);
    let mut builder = Builder::of_objects().map_err(whole)?;
    let mut record = [0; VERSION_2.record_bytes];
    let record = &mut record[..version.record_bytes];
    while records.next_record(record)? {
        if !version.is_of(record) {
            let (found, expected) = (record[version.version + 1], version.number);
            return Err(records.error(format!("a record of version {found}, expected {expected} as in the first one")));
        }
        let length: u32 = bytemuck::pod_read_unaligned(&record[version.length..version.length + 4]);
        let block: u64 = bytemuck::pod_read_unaligned(&record[version.block..version.block + 8]);
        let kind = match record[version.command] {
            // WRITE of 6, 10, 12 and 16 bytes.
            0x0a | 0x2a | 0xaa | 0x8a => AccessKind::Write,
            _ => AccessKind::Read,
        };
        let object = builder.object(kind, ObjectId::Number(block), u64::from(length));
        object.map_err(|what| records.error(what))?;
    }
    builder.finish(line_bytes).map_err(|what| records.whole(what))
}

impl Version {
    fn is_of(&self, record: &[u8]) -> bool {
        record.get(self.version + 1) == Some(&self.number)
    }
}
