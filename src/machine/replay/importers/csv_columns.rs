//! Which column of a table has what: as a person says, and else by the names and the first row.

use std::str::FromStr;

use super::csv_fields::{Fields, UNCLOSED};
use super::text_file::{quoted, unsigned};

/// What a person may say about a table.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct CsvOptions {
    /// Addresses of bytes.
    pub address: Option<Column>,
    /// Ids of objects: numbers or text. Either these or addresses.
    pub id: Option<Column>,
    /// Bytes of a reference or an object.
    pub size: Option<Column>,
    /// What a reference does.
    pub operation: Option<Column>,
    /// Bytes that an address counts; it makes a column of addresses of one named `lbn` or the like.
    pub address_unit: Option<u32>,
    pub separator: Option<Separator>,
    /// Whether the first row has the names of the columns.
    pub header: Option<bool>,
}

/// A column, as a person says which.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Column {
    /// From 1.
    Number(u32),
    Name(String),
}

impl FromStr for Column {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.parse() {
            Ok(0) => Err("expected a column's name, or its number from 1"),
            Ok(number) => Ok(Self::Number(number)),
            Err(_) if text.trim().is_empty() => Err("expected a column's name, or its number from 1"),
            Err(_) => Ok(Self::Name(text.trim().to_owned())),
        }
    }
}

/// What is between two fields.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Separator(u8);

impl FromStr for Separator {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "comma" => Ok(Self(b',')),
            "tab" | "\\t" => Ok(Self(b'\t')),
            "semicolon" => Ok(Self(b';')),
            "blank" => Ok(Self(b' ')),
            _ => match text.as_bytes() {
                [one] if (one.is_ascii_punctuation() && *one != b'"') || matches!(one, b' ' | b'\t') => Ok(Self(*one)),
                _ => Err(
                    "expected comma, tab, semicolon, blank, or a character that is no letter, digit or quotation mark",
                ),
            },
        }
    }
}

/// What a reference is to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Place {
    /// To bytes; an address counts so many.
    Address { unit: u32 },
    /// To objects.
    Id,
}

/// Where everything is, as indices from 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Columns {
    pub(super) separator: u8,
    pub(super) has_header: bool,
    pub(super) place: Place,
    pub(super) place_column: usize,
    pub(super) size: Option<usize>,
    pub(super) operation: Option<usize>,
    /// How many there are.
    pub(super) count: usize,
}

/// Names of columns of addresses or ids, the first that there is counts.
const PLACES: [(&str, Place); 12] = [
    ("address", Place::Address { unit: 1 }),
    ("addr", Place::Address { unit: 1 }),
    ("lbn", Place::Id),
    ("lba", Place::Id),
    ("id", Place::Id),
    ("obj_id", Place::Id),
    ("object_id", Place::Id),
    ("objid", Place::Id),
    ("object", Place::Id),
    ("key", Place::Id),
    ("block", Place::Id),
    ("offset", Place::Address { unit: 1 }),
];
const SIZES: [&str; 6] = ["bytes", "size", "length", "len", "obj_size", "object_size"];
const OPERATIONS: [&str; 4] = ["op", "operation", "type", "rw"];

impl Columns {
    /// By the first row. An error has a byte of it, from 0.
    pub(super) fn new(first: &[u8], options: &CsvOptions) -> Result<Self, (usize, String)> {
        let separator = options.separator.map_or_else(|| separator(first), |separator| separator.0);
        let mut fields = Vec::new();
        for field in Fields::new(first, separator) {
            fields.push(field.map_err(|at| (at, UNCLOSED.to_owned()))?);
        }
        let names: Vec<&[u8]> = fields.iter().map(|field| field.bytes).collect();
        let header = Header { names: &names, is_there: has_header(&names, options)? };
        let known = |place: &(&str, Place)| Ok::<_, (usize, String)>(header.known(place.0)?.map(|at| (at, place.1)));
        let (place_column, place) = match (&options.address, &options.id) {
            (Some(address), _) => (header.find(address)?, Place::Address { unit: 1 }),
            (None, Some(id)) => (header.find(id)?, Place::Id),
            (None, None) => {
                let mut found = None;
                for place in &PLACES {
                    found = found.or(known(place)?);
                }
                match found {
                    Some(found) => found,
                    None if names.len() == 1 && !header.is_there => (0, Place::Id),
                    None => return Err((0, header.no_place())),
                }
            }
        };
        let place = match (place, options.address_unit) {
            (place, None) => place,
            (Place::Id, Some(_)) if options.id.is_some() => {
                return Err((0, "ids have no unit, expected a unit of addresses, or no unit".to_owned()));
            }
            (_, Some(unit)) => Place::Address { unit },
        };
        Ok(Self {
            separator,
            has_header: header.is_there,
            place,
            place_column,
            size: header.find_or(options.size.as_ref(), &SIZES, place_column)?,
            operation: header.find_or(options.operation.as_ref(), &OPERATIONS, place_column)?,
            count: names.len(),
        })
    }
}

/// What of the usual separators there is most of, outside of quotation marks; the first of these where that is undecided.
fn separator(first: &[u8]) -> u8 {
    const USUAL: [u8; 4] = [b',', b'\t', b';', b' '];
    let trimmed = first.trim_ascii();
    let count = |separator: u8| Fields::new(trimmed, separator).count();
    // The last of the largest, from the end.
    USUAL.into_iter().rev().max_by_key(|&separator| count(separator)).unwrap_or(b',')
}

/// Names say that it is a header, and numbers that it is none.
fn has_header(names: &[&[u8]], options: &CsvOptions) -> Result<bool, (usize, String)> {
    if let Some(said) = options.header {
        return Ok(said);
    }
    let CsvOptions { address, id, size, operation, .. } = options;
    if [address, id, size, operation].into_iter().flatten().any(|column| matches!(column, Column::Name(_))) {
        return Ok(true);
    }
    let known = PLACES.map(|place| place.0).into_iter().chain(SIZES).chain(OPERATIONS);
    let is_known = |name: &&[u8]| known.clone().any(|known| name.eq_ignore_ascii_case(known.as_bytes()));
    if names.iter().any(is_known) {
        return Ok(true);
    }
    let is_number = |name: &&[u8]| unsigned(name).is_some() || std::str::from_utf8(name).is_ok_and(is_decimal);
    if names.iter().any(is_number) {
        return Ok(false);
    }
    let what = "a first row without a number or a known name, expected --csv-header: whether it names the columns";
    Err((0, what.to_owned()))
}

/// A decimal number with a fraction, as times are.
fn is_decimal(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_digit() || matches!(c, '-' | '.')) && text.parse::<f64>().is_ok()
}

/// The first row.
struct Header<'a> {
    names: &'a [&'a [u8]],
    /// Whether these are names.
    is_there: bool,
}

impl Header<'_> {
    /// The column of this name, if there is one.
    fn known(&self, name: &str) -> Result<Option<usize>, (usize, String)> {
        if !self.is_there {
            return Ok(None);
        }
        let mut found = (0..).zip(self.names).filter(|(_, other)| other.eq_ignore_ascii_case(name.as_bytes()));
        match (found.next(), found.next()) {
            (Some(_), Some((_, second))) => {
                Err((self.at(second), format!("a second column {}, expected one", quoted(second))))
            }
            (first, _) => Ok(first.map(|(at, _)| at)),
        }
    }

    /// Where a name starts in its row.
    fn at(&self, name: &[u8]) -> usize {
        // All are parts of the row.
        self.names.first().map_or(0, |first| name.as_ptr() as usize - first.as_ptr() as usize)
    }

    fn find(&self, column: &Column) -> Result<usize, (usize, String)> {
        match column {
            Column::Number(number) if *number as usize <= self.names.len() => Ok(*number as usize - 1),
            Column::Number(number) => {
                Err((0, format!("no column {number}, expected one of 1 to {}", self.names.len())))
            }
            Column::Name(name) if !self.is_there => {
                Err((0, format!("no names of columns, expected a number for {}", quoted(name.as_bytes()))))
            }
            Column::Name(name) => self.known(name)?.ok_or_else(|| {
                let names: Vec<String> = self.names.iter().map(|name| quoted(name)).collect();
                (0, format!("no column {}, expected one of {}", quoted(name.as_bytes()), shortened(&names)))
            }),
        }
    }

    /// What a person says, or else the first of these names that there is, if it is no other column already.
    fn find_or(&self, column: Option<&Column>, names: &[&str], taken: usize) -> Result<Option<usize>, (usize, String)> {
        if let Some(column) = column {
            let found = self.find(column)?;
            if found == taken {
                return Err((0, format!("column {} twice, expected another one", found + 1)));
            }
            return Ok(Some(found));
        }
        for name in names {
            if let Some(found) = self.known(name)?.filter(|&found| found != taken) {
                return Ok(Some(found));
            }
        }
        Ok(None)
    }

    fn no_place(&self) -> String {
        let names = PLACES.map(|(name, _)| name).join(", ");
        if self.is_there {
            format!("no column of addresses or ids, expected one named {names}, or to be told which")
        } else {
            "no names of columns, expected the numbers of those that are used, such as --csv-address 1".to_owned()
        }
    }
}

/// Not more names than fit into a message.
fn shortened(names: &[String]) -> String {
    const SHOWN_MAX: usize = 12;
    let shown = names[..names.len().min(SHOWN_MAX)].join(", ");
    if names.len() > SHOWN_MAX { format!("{shown}, …") } else { shown }
}
