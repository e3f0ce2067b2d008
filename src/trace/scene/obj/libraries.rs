//! `mtllib`: which of the names on its line are files, and what they define.

use std::collections::HashSet;
use std::path::PathBuf;

use super::materials::Materials;
use super::mtl;
use crate::scene::cursor::{Cursor, Token};
use crate::scene::source::Source;
use crate::scene::{SourceError, Warning, Warnings};

/// How many names are looked for. Each costs some calls of the file system.
const NAMES_MAX: usize = 4096;

/// How a name has to be that of a file.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Spelling {
    Exact,
    /// But for upper and lower case.
    AnyCase,
}

/// The libraries of a scene. `R` reads one by its name, and gives `None` when there is no such file.
pub(super) struct Libraries<R> {
    read: R,
    materials: Materials,
    warnings: Vec<Warning>,
    /// Lines that were read already.
    lines: HashSet<Vec<u8>>,
    files: HashSet<PathBuf>,
    names_left: usize,
}

/// A library, and whether its name was another.
struct Found {
    library: Result<Source, SourceError>,
    is_elsewhere: bool,
}

impl<R: Fn(&[u8], Spelling) -> Option<Result<Source, SourceError>>> Libraries<R> {
    pub(super) fn new(read: R) -> Self {
        Self {
            read,
            materials: Materials::default(),
            warnings: Vec::new(),
            lines: HashSet::new(),
            files: HashSet::new(),
            names_left: NAMES_MAX,
        }
    }

    /// Reads the libraries that a line names: the first that is there of the whole line, the line without a comment,
    /// its words one by one, and the last part of its path beside the file.
    pub(super) fn add(&mut self, line: Token, cursor: &Cursor, warnings: &mut Warnings) {
        if line.bytes.is_empty() || !self.lines.insert(line.bytes.to_vec()) {
            return;
        }
        let mut warn = |kind, name: Token, what: &str| {
            cursor.warn(warnings, kind, name, format_args!("{what}"));
        };
        let name = line.without_comment();
        let words: Vec<Token> = name.words().take(NAMES_MAX + 1).collect();
        if words.len() > self.names_left {
            warn(
                "too-many-libraries",
                name,
                &format!(" is one too many, expected at most {NAMES_MAX} names: is not read"),
            );
            return;
        }
        self.names_left -= words.len();
        for (name, found) in self.look_for(line, name, &words) {
            match found {
                None => warn("missing-library", name, ": no such file, white is used for its materials"),
                Some(Found { library: Err(error), .. }) => {
                    warn("unreadable-library", name, &format!(": {}: white is used for its materials", error.what));
                }
                Some(Found { library: Ok(library), is_elsewhere }) => {
                    if is_elsewhere {
                        let file = library.file.as_os_str().as_encoded_bytes().escape_ascii();
                        warn("library-elsewhere", name, &format!(": no such file, \"{file}\" is read"));
                    }
                    if self.files.insert(library.file.clone()) {
                        self.warnings.extend(mtl::read(&library, &mut self.materials).all().iter().cloned());
                    }
                }
            }
        }
    }

    fn look_for<'a>(&self, line: Token<'a>, name: Token<'a>, words: &[Token<'a>]) -> Vec<(Token<'a>, Option<Found>)> {
        if let Some(found) = [line, name].into_iter().find_map(|name| self.as_named(name)) {
            return vec![(name, Some(found))];
        }
        // Several names, or one with blanks in its folders.
        let look = |&word: &Token<'a>| (word, self.as_named(word).or_else(|| self.beside(word)));
        let found: Vec<_> = if words.len() > 1 { words.iter().map(look).collect() } else { Vec::new() };
        let is_found = |(_, found): &(Token, Option<Found>)| found.is_some();
        if !found.is_empty() && found.iter().all(is_found) {
            return found;
        }
        let whole = self.beside(name);
        if whole.is_none() && found.iter().any(is_found) { found } else { vec![(name, whole)] }
    }

    /// The file of a name; `\` may be meant for `/`.
    fn as_named(&self, name: Token) -> Option<Found> {
        self.first_of(name, &[name.bytes, &with_slashes(name)])
    }

    /// The file beside the OBJ file that has the last part of a name.
    fn beside(&self, name: Token) -> Option<Found> {
        let name_with_slashes = with_slashes(name);
        let last = name_with_slashes.rsplit(|&b| b == b'/').next().filter(|last| !last.is_empty())?;
        self.first_of(name, &[last])
    }

    fn first_of(&self, name: Token, candidates: &[&[u8]]) -> Option<Found> {
        for spelling in [Spelling::Exact, Spelling::AnyCase] {
            for candidate in candidates {
                if let Some(library) = (self.read)(candidate, spelling) {
                    let is_elsewhere = spelling == Spelling::AnyCase || *candidate != name.bytes;
                    return Some(Found { library, is_elsewhere });
                }
            }
        }
        None
    }

    /// What all of them define, their warnings, and the files, sorted.
    pub(super) fn finish(self) -> (Materials, Vec<Warning>, Vec<PathBuf>) {
        let mut files: Vec<_> = self.files.into_iter().collect();
        files.sort();
        (self.materials, self.warnings, files)
    }
}

fn with_slashes(name: Token) -> Vec<u8> {
    name.bytes.iter().map(|&b| if b == b'\\' { b'/' } else { b }).collect()
}
