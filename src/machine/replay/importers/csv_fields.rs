//! The fields of a line of a table.

/// What is wrong with a field in quotation marks.
pub(super) const UNCLOSED: &str =
    "a quotation mark that is not closed on its line, or text after it, expected one and a separator";

#[derive(Clone, Copy, Debug)]
pub(super) struct Field<'a> {
    /// Where it starts in its line.
    pub(super) at: usize,
    /// Without blanks and quotation marks around it; quotation marks within stay doubled.
    pub(super) bytes: &'a [u8],
}

/// The fields of a line; where one starts that is in quotation marks and does not end as it should, and then no more.
/// Several blanks are one separator, and none at the ends of a line.
pub(super) struct Fields<'a> {
    line: &'a [u8],
    separator: u8,
    /// Where the next one starts, if there is one.
    next: Option<usize>,
}

impl<'a> Fields<'a> {
    pub(super) fn new(line: &'a [u8], separator: u8) -> Self {
        let line = if separator == b' ' { line.trim_ascii_end() } else { line };
        let start = if separator == b' ' { line.len() - line.trim_ascii_start().len() } else { 0 };
        Self { line, separator, next: Some(start) }
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<Field<'a>, usize>;

    fn next(&mut self) -> Option<Self::Item> {
        let start = self.next.take()?;
        let rest = &self.line[start..];
        // A separator within quotation marks is none; a doubled quotation mark closes and opens again.
        let mut in_quotes = false;
        let ends = |byte: &u8| {
            in_quotes ^= *byte == b'"';
            *byte == self.separator && !in_quotes
        };
        let length = rest.iter().position(ends).unwrap_or(rest.len());
        if length < rest.len() {
            let after = &rest[length + 1..];
            let blanks = if self.separator == b' ' { after.len() - after.trim_ascii_start().len() } else { 0 };
            self.next = Some(start + length + 1 + blanks);
        }
        let field = rest[..length].trim_ascii();
        let at = start + length - rest[..length].trim_ascii_start().len();
        let bytes = match field {
            [b'"', inner @ .., b'"'] => inner,
            [b'"', ..] => return Some(Err(at)),
            _ => field,
        };
        Some(Ok(Field { at, bytes }))
    }
}
