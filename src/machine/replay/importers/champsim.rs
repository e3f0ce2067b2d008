//! Traces of instructions in ChampSim's binary format (its `inc/trace_instruction.h`).

use std::io::BufRead;
use std::path::Path;

use super::access::{Access, AccessKind};
use super::binary_file::BinaryFile;
use super::builder::Builder;
use super::imported::Imported;
use trace::scene::SourceError;

/// u64 instruction pointer; u8 whether it is a branch, and u8 whether that is taken; u8 registers, 2 destinations and 4
/// sources; u64 addresses, 2 destinations and 4 sources; little-endian.
const INSTRUCTION_BYTES: usize = 64;
const BRANCH: usize = 8;
const DESTINATIONS: usize = 16;
const SOURCES: usize = 32;

/// Reads a trace: each instruction is fetched, then its sources are read, then its destinations are written. Addresses that
/// are 0 are none. Nothing has a size: a reference is to the line that its address lies in.
///
/// # Errors
/// The byte where something is wrong, and what was expected.
pub fn read(file: &Path, input: impl BufRead, line_bytes: u32) -> Result<Imported, SourceError> {
    let mut records = BinaryFile::new(file, input);
    let mut builder = Builder::of_bytes().map_err(|what| records.whole(what))?;
    let mut record = [0; INSTRUCTION_BYTES];
    while records.next_record(&mut record)? {
        if !is_instruction(&record) {
            let (branch, taken) = (record[BRANCH], record[BRANCH + 1]);
            let what = format!("an instruction that is a branch: {branch}, and taken: {taken}; expected 0 or 1 each");
            return Err(records.error(what));
        }
        let address = |at: usize| bytemuck::pod_read_unaligned::<u64>(&record[at..at + 8]);
        let addresses = |kind, start, end| (start..end).step_by(8).map(move |at| (kind, address(at)));
        let fetch = [(AccessKind::Fetch, address(0))].into_iter();
        let reads = addresses(AccessKind::Read, SOURCES, INSTRUCTION_BYTES);
        let writes = addresses(AccessKind::Write, DESTINATIONS, SOURCES);
        for (kind, address) in fetch.chain(reads).chain(writes).filter(|&(_, address)| address != 0) {
            builder.access(Access { kind, address, bytes: 1 }).map_err(|what| records.error(what))?;
        }
    }
    builder.finish(line_bytes).map_err(|what| records.whole(what))
}

fn is_instruction(record: &[u8]) -> bool {
    record[BRANCH] <= 1 && record[BRANCH + 1] <= 1
}

/// Whether this is certainly the beginning of such a trace: of eight instructions or more, all have an address of 48 bits
/// that is not 0, and only branches are taken.
pub(super) fn is_beginning(prefix: &[u8]) -> bool {
    const CERTAIN: usize = 8;
    let instructions = prefix.chunks_exact(INSTRUCTION_BYTES);
    let is_certain = |record: &[u8]| {
        let address: u64 = bytemuck::pod_read_unaligned(&record[..8]);
        is_instruction(record) && record[BRANCH + 1] <= record[BRANCH] && (1..1 << 48).contains(&address)
    };
    instructions.len() >= CERTAIN && instructions.into_iter().all(is_certain)
}
