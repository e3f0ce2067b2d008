//! The formats of traces, and how one is recognised.

use std::path::Path;

use super::text_file::words;
use super::{champsim, din, lackey, oracle_general, ramulator};

/// A format that can be imported.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub enum ImportFormat {
    /// Dinero's text, classic or extended
    Din,
    /// libCacheSim's binary oracleGeneral
    OracleGeneral,
    /// A table of text, its columns named or numbered
    Csv,
    /// A list of ids, one per line
    Ids,
    /// VMware's binary vscsi, versions 1 and 2
    Vscsi,
    /// The output of valgrind --tool=lackey --trace-mem=yes
    Lackey,
    /// ChampSim's binary instructions
    Champsim,
    /// Ramulator's text: LD and ST, or R and W
    Ramulator,
    /// JSON, an object with "address" per line
    Json,
}

/// A list for messages: each format, and the names of its files or what it is recognised by.
pub const FORMATS: &str = "din (.din), oracle-general (.oracleGeneral, .oracleGeneral.bin), csv (.csv, .tsv), ids (.txt, .ids), \
    vscsi (.vscsi), lackey (by its lines), champsim (.champsim, .champsimtrace), ramulator (by its lines), json (.json, .jsonl), \
    each also in .gz, .zst or .xz";

impl ImportFormat {
    /// By the beginning of a trace where that leaves no doubt, else by the file's name. A table may look like many formats: its
    /// name comes first. What is not clearly a list of ids is none, whatever its name.
    pub fn recognise(path: &Path, prefix: &[u8]) -> Option<Self> {
        let named = Self::by_name(path);
        if named == Some(Self::Csv) {
            return named;
        }
        let is_list = first_line(prefix).is_none_or(|line| words(line).count() == 1);
        let named = named.filter(|format| *format != Self::Ids || is_list);
        Self::by_text(prefix).or(named).or_else(|| Self::by_records(prefix))
    }

    /// Whether a file of this name would be taken for a trace.
    pub fn is_named(path: &Path) -> bool {
        Self::by_name(path).is_some()
    }

    fn by_text(prefix: &[u8]) -> Option<Self> {
        let first = first_line(prefix)?;
        if lackey::is_line(first) {
            return Some(Self::Lackey);
        }
        if ramulator::is_line(first) {
            return Some(Self::Ramulator);
        }
        if din::is_extended_line(first) {
            return Some(Self::Din);
        }
        // A quotation mark is next in any object that has something.
        let object = first.trim_ascii().strip_prefix(b"{")?;
        object.trim_ascii_start().starts_with(b"\"").then_some(Self::Json)
    }

    /// As libCacheSim and others name their files.
    fn by_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let compressions = [".gz", ".zst", ".xz"];
        let name = compressions.iter().find_map(|end| name.strip_suffix(end)).unwrap_or(&name);
        if name.contains("oraclegeneral") && !name.contains("oraclegeneralopns") {
            return Some(Self::OracleGeneral);
        }
        if name.contains(".vscsi") {
            return Some(Self::Vscsi);
        }
        if name.contains(".champsim") {
            return Some(Self::Champsim);
        }
        match name.rsplit_once('.')?.1 {
            "din" | "xdin" => Some(Self::Din),
            "csv" | "tsv" => Some(Self::Csv),
            "txt" | "ids" => Some(Self::Ids),
            "json" | "jsonl" | "ndjson" => Some(Self::Json),
            _ => None,
        }
    }

    fn by_records(prefix: &[u8]) -> Option<Self> {
        if champsim::is_beginning(prefix) {
            return Some(Self::Champsim);
        }
        oracle_general::is_beginning(prefix).then_some(Self::OracleGeneral)
    }
}

/// The first line that is not empty.
fn first_line(prefix: &[u8]) -> Option<&[u8]> {
    prefix.split(|byte| *byte == b'\n').find(|line| !line.trim_ascii().is_empty())
}
