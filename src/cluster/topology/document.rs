//! A topology's TOML with its overrides in place: every value knows who wrote it, so that whatever is
//! wrong with it can be said at its place.

use std::ops::Range;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::overrides::Override;
use trace::scene::SourceError;
use trace::scene::source::Source;

/// A span before the end of the text is a place in the file; the i-th after it is the i-th override.
pub(super) struct Document<'a> {
    source: &'a Source,
    overrides: &'a [Override],
    root: Spanned<DeValue<'a>>,
}

impl<'a> Document<'a> {
    /// # Errors
    /// The bytes are not TOML, or an override's key leads nowhere.
    pub(super) fn parse(source: &'a Source, overrides: &'a [Override]) -> Result<Self, SourceError> {
        let text = std::str::from_utf8(&source.bytes)
            .map_err(|error| source.error(error.valid_up_to(), "not UTF-8, expected a text file"))?;
        let empty = Spanned::new(0..0, DeValue::Table(DeTable::new()));
        let mut document = Self { source, overrides, root: empty };
        let table = DeTable::parse(text).map_err(|error| {
            let message = error.message();
            let hint = if message.contains(", expected ") { "" } else { ", expected valid TOML" };
            document.refuse(error.span(), format!("{message}{hint}"))
        })?;
        let mut root = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
        for key in overrides.iter().flat_map(Override::displaces) {
            remove(root.get_mut(), key);
        }
        for (i, one) in overrides.iter().enumerate() {
            let span = document.override_span(i);
            one.apply(&mut root, span.clone()).map_err(|what| document.refuse(Some(span), what))?;
        }
        document.root = root;
        Ok(document)
    }

    /// # Errors
    /// The first key that is unknown, missing, or not of its type or within its range.
    pub(super) fn read<T: DeserializeOwned>(&self) -> Result<T, SourceError> {
        let deserializer = ValueDeserializer::from(self.root.clone());
        serde_path_to_error::deserialize(deserializer).map_err(|error| {
            let key = error.path().to_string();
            let error = error.into_inner();
            let written = error.span().map(|span| self.written(span)).unwrap_or_default();
            self.refuse(error.span(), reworded(&key, &written, error.message()))
        })
    }

    /// An error about several keys together, at the place of the first that an override has set, else of
    /// the first that there is.
    pub(super) fn error(&self, keys: &[&str], what: impl Into<String>) -> SourceError {
        let spans: Vec<_> = keys.iter().filter_map(|key| self.span(key)).collect();
        let culprit = spans.iter().find(|span| self.override_index(span).is_some()).or(spans.first());
        self.refuse(culprit.cloned(), what.into())
    }

    /// Whether the key was set by an override, not by the file.
    pub(super) fn is_overridden(&self, key: &str) -> bool {
        self.span(key).is_some_and(|span| self.override_index(&span).is_some())
    }

    fn span(&self, key: &str) -> Option<Range<usize>> {
        key.split('.').try_fold(&self.root, part_of).map(Spanned::span)
    }

    fn override_span(&self, index: usize) -> Range<usize> {
        let start = self.source.bytes.len() + 1 + index;
        start..start
    }

    fn override_index(&self, span: &Range<usize>) -> Option<usize> {
        span.start.checked_sub(self.source.bytes.len() + 1)
    }

    /// The beginning of what is there.
    fn written(&self, span: Range<usize>) -> String {
        const CHARACTERS_MAX: usize = 40;
        let text = match self.override_index(&span).and_then(|index| self.overrides.get(index)) {
            Some(one) => one.value().into(),
            None => String::from_utf8_lossy(self.source.bytes.get(span).unwrap_or_default()),
        };
        let line = text.lines().next().unwrap_or_default();
        let shown: String = line.chars().take(CHARACTERS_MAX).collect();
        match shown.len() {
            0 => "empty".to_owned(),
            length if length < text.len() => shown + "…",
            _ => shown,
        }
    }

    /// Keys may hold anything, also what would make a terminal do strange things.
    fn refuse(&self, span: Option<Range<usize>>, what: String) -> SourceError {
        let what = what.replace(char::is_control, "�");
        let Some(span) = span else { return SourceError::new(&self.source.file, None, what) };
        match self.override_index(&span).and_then(|index| self.overrides.get(index)) {
            Some(one) => SourceError::new(Path::new(&one.to_string()), None, what),
            None => self.source.error(span.start, what),
        }
    }
}

/// What a table has under a key, or an array at a number.
fn part_of<'v, 'a>(value: &'v Spanned<DeValue<'a>>, key: &str) -> Option<&'v Spanned<DeValue<'a>>> {
    match value.get_ref() {
        DeValue::Array(elements) => elements.get(key.parse::<usize>().ok()?),
        value => value.get(key),
    }
}

fn remove(root: &mut DeValue<'_>, key: &str) {
    let DeValue::Table(table) = root else { return };
    match key.split_once('.') {
        None => drop(table.remove(key)),
        Some((first, rest)) => {
            if let Some(child) = table.get_mut(first) {
                remove(child.get_mut(), rest);
            }
        }
    }
}

/// serde's message in the words of someone who writes topologies, with what is `written` there.
fn reworded(key: &str, written: &str, message: &str) -> String {
    let (what, expected) = message.split_once(", expected ").unwrap_or((message, ""));
    let name = what.split('`').nth(1).unwrap_or_default();
    let names: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    let key = if key == "." { "the topology" } else { key };
    if what.starts_with("unknown field") {
        format!("unknown key {key}, expected {}", choice(name, &names))
    } else if what.starts_with("unknown variant") {
        format!("{key} is {written}, expected {}", choice(name, &names))
    } else if what.starts_with("missing field") {
        format!("{key}.{name} is missing, expected a value")
    } else {
        let expected = match expected {
            "" if what.ends_with("overflowed") => "a smaller number",
            "" => what,
            "a sequence" => "an array of tables",
            "an array of length 3" => "three numbers",
            expected => expected,
        };
        format!("{key} is {written}, expected {expected}")
    }
}

/// The names that are known, and the one that was probably meant.
fn choice(name: &str, names: &[&str]) -> String {
    const SIMILARITY_MIN: f64 = 0.8;
    let similarity = |known: &&&str| strsim::jaro_winkler(name, known);
    let nearest = names.iter().max_by(|a, b| similarity(a).total_cmp(&similarity(b)));
    let list = match names {
        [one] => (*one).to_owned(),
        names => format!("one of {}", names.join(", ")),
    };
    match nearest.filter(|nearest| similarity(nearest) > SIMILARITY_MIN) {
        Some(nearest) => format!("{list}; did you mean {nearest}?"),
        None => list,
    }
}
