//! A reference of a trace, as its format has it.

/// What a reference does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AccessKind {
    /// Reads data, or something that is neither an instruction nor a write.
    Read,
    /// Reads an instruction.
    Fetch,
    Write,
    /// Writes back what of it is dirty, and keeps it.
    CopyBack,
    /// Drops it, dirty or not.
    Invalidate,
}

/// A reference to bytes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Access {
    pub kind: AccessKind,
    /// Of the first byte.
    pub address: u64,
    /// 1 to 2²⁰.
    pub bytes: u32,
}

/// What an object is known by. A number and a text are never the same object.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(super) enum ObjectId<'a> {
    Number(u64),
    Text(&'a [u8]),
}

impl<'a> ObjectId<'a> {
    /// Decimal digits without a leading zero, and hexadecimal ones after `0x`, of at most 64 bits are a number; all else is
    /// text.
    pub(super) fn parse(bytes: &'a [u8]) -> Self {
        use super::text_file::{hexadecimal, number};
        let known = match (hexadecimal(bytes), bytes) {
            (Some(digits), _) => number(digits, 16),
            (None, [b'0', _, ..]) => None,
            (None, _) => number(bytes, 10),
        };
        known.map_or(Self::Text(bytes), Self::Number)
    }
}
