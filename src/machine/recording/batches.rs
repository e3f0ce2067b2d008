//! The batches of an Arrow IPC stream with known columns.
//!
//! Arrow's own readers panic on a buffer outside of its body and reserve what lengths claim; here all that a
//! frame's metadata say is held against the frame before Arrow sees it.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::{ArrayRef, RecordBatch};
use arrow_buffer::{Buffer, MutableBuffer};
use arrow_ipc::convert::try_fb_to_schema;
use arrow_ipc::reader::{read_dictionary, read_record_batch};
use arrow_ipc::{Endianness, Field as WrittenField, MetadataVersion, RecordBatch as Described, Type};
use arrow_schema::{DataType, Schema, SchemaRef};

use super::frames::{Frame, FrameError, FrameFault, FrameKind, FrameLimits, Frames, ReadAt, StreamEnd};

/// Lists of lists of lists are more than any recording has.
const NESTING_MAX: u32 = 3;

/// The most that a batch may take.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct BatchLimits {
    pub frame: FrameLimits,
    pub rows: u32,
}

/// Where a stream stops being one of these columns.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("byte {offset}, {}: {what}", place(*.batch))]
pub struct BatchError {
    pub offset: u64,
    /// From 0; the schema is the first.
    pub frame: u64,
    /// From 0; all batches before it are sound. `None`: the schema is not.
    pub batch: Option<u64>,
    /// Expected and found.
    pub what: String,
    /// The file ended too early, as one does whose writer was killed.
    pub is_cut: bool,
}

fn place(batch: Option<u64>) -> String {
    batch.map_or_else(|| "schema".to_owned(), |batch| format!("batch {batch}"))
}

/// Rows that are adjacent.
#[derive(Clone, PartialEq, Debug)]
pub struct Batch {
    /// From 0.
    pub number: u64,
    /// Of its frame.
    pub offset: u64,
    /// Of its frame, from 0; the schema is the first.
    pub frame: u64,
    /// The columns asked for, in the order asked for.
    pub columns: RecordBatch,
    /// The columns' buffers lie in it.
    body: Buffer,
    body_offset: u64,
}

impl Batch {
    /// Where in the file these values of a column begin; `None` if they are not of this batch, or lie there out of line,
    /// so that Arrow copied them.
    pub fn place(&self, values: &[u8]) -> Option<u64> {
        let at = values.as_ptr().addr().checked_sub(self.body.as_ptr().addr())?;
        (at + values.len() <= self.body.len()).then(|| self.body_offset + at as u64)
    }
}

/// Reads batch by batch; holds one of them at a time, and the dictionaries.
#[derive(Debug)]
pub struct Batches<F> {
    frames: Frames<F>,
    limits: BatchLimits,
    /// As written; columns may follow those asked for.
    schema: SchemaRef,
    projection: Vec<usize>,
    dictionaries: HashMap<i64, ArrayRef>,
    number: u64,
}

impl<F: ReadAt> Batches<F> {
    /// Reads the schema. [`Self::with_columns`] says which columns to read.
    ///
    /// # Errors
    /// The stream does not begin with a schema of such columns as recordings have.
    pub fn open(file: F, limits: BatchLimits) -> Result<Self, BatchError> {
        let mut frames = Frames::new(file, limits.frame).map_err(|error| of_frame(error, None))?;
        let first = frames.next_frame().map_err(|error| of_frame(error, None))?;
        let first = first.ok_or_else(|| of_schema("expected a schema, the stream is empty".to_owned()))?;
        let schema = Arc::new(schema(&first).map_err(of_schema)?);
        Ok(Self { frames, limits, schema, projection: Vec::new(), dictionaries: HashMap::new(), number: 0 })
    }

    /// To read these columns, which the schema begins with: by name, type and whether they may be null.
    ///
    /// # Errors
    /// It begins with others.
    pub fn with_columns(self, columns: &Schema) -> Result<Self, BatchError> {
        same_columns(&self.schema, columns).map_err(of_schema)?;
        Ok(Self { projection: (0..columns.fields().len()).collect(), ..self })
    }

    /// As written, with the metadata of the recording.
    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    /// `None` until the end was reached.
    pub fn end(&self) -> Option<StreamEnd> {
        self.frames.end()
    }

    /// Where the next batch, or the dictionary before it, begins.
    pub fn offset(&self) -> u64 {
        self.frames.offset()
    }

    /// The next batch; `None` at the end.
    ///
    /// # Errors
    /// It is not one of these columns. It fails again when called again.
    pub fn next_batch(&mut self) -> Result<Option<Batch>, BatchError> {
        loop {
            let frame = self.frames.next_frame().map_err(|error| of_frame(error, Some(self.number)))?;
            let Some(frame) = frame else { return Ok(None) };
            match frame.kind {
                FrameKind::Schema => return Err(self.fault(&frame, "expected a batch, found another schema".into())),
                FrameKind::Dictionary => self.learn(&frame)?,
                FrameKind::Batch => {
                    let batch = self.batch(&frame)?;
                    self.number += 1;
                    return Ok(Some(batch));
                }
            }
        }
    }

    fn batch(&self, frame: &Frame) -> Result<Batch, BatchError> {
        let message = frame.message().map_err(|error| of_frame(error, Some(self.number)))?;
        let fault = |what| self.fault(frame, what);
        let described = message.header_as_record_batch().ok_or_else(|| fault("expected a batch".to_owned()))?;
        check(message.version(), &described, frame.body_bytes, self.limits.rows).map_err(fault)?;
        buffers_fit(&described, self.schema.fields().iter().map(|field| field.data_type())).map_err(fault)?;
        let body = self.body(frame)?;
        let (schema, version) = (Arc::clone(&self.schema), message.version());
        let columns = read_record_batch(&body, described, schema, &self.dictionaries, Some(&self.projection), &version)
            .map_err(|error| fault(error.to_string()))?;
        let (number, offset, body_offset) = (self.number, frame.offset, frame.body_offset);
        Ok(Batch { number, offset, frame: frame.number, columns, body, body_offset })
    }

    fn learn(&mut self, frame: &Frame) -> Result<(), BatchError> {
        let message = frame.message().map_err(|error| of_frame(error, Some(self.number)))?;
        let fault = |what: &str| self.fault(frame, what.to_owned());
        let dictionary = message.header_as_dictionary_batch().ok_or_else(|| fault("expected a dictionary"))?;
        let described = dictionary.data().ok_or_else(|| fault("expected a dictionary with words"))?;
        if dictionary.isDelta() {
            return Err(fault("expected a whole dictionary, found an addition to one"));
        }
        check(message.version(), &described, frame.body_bytes, self.limits.rows).map_err(|what| fault(&what))?;
        // The only kind of dictionary that a schema may have here.
        buffers_fit(&described, [&DataType::Utf8].into_iter()).map_err(|what| fault(&what))?;
        let body = self.body(frame)?;
        let version = message.version();
        let read = read_dictionary(&body, dictionary, &self.schema, &mut self.dictionaries, &version);
        read.map_err(|error| self.fault(frame, error.to_string()))
    }

    fn body(&self, frame: &Frame) -> Result<Buffer, BatchError> {
        // Aligned for any column, unlike a vector of bytes.
        let mut body = MutableBuffer::from_len_zeroed(usize::try_from(frame.body_bytes).unwrap_or(usize::MAX));
        frame.read_body(self.frames.file(), &mut body).map_err(|error| of_frame(error, Some(self.number)))?;
        Ok(body.into())
    }

    fn fault(&self, frame: &Frame, what: String) -> BatchError {
        BatchError { offset: frame.offset, frame: frame.number, batch: Some(self.number), what, is_cut: false }
    }
}

fn of_frame(error: FrameError, batch: Option<u64>) -> BatchError {
    let is_cut = matches!(error.fault, FrameFault::Cut { .. });
    BatchError { offset: error.offset, frame: error.frame, batch, what: error.fault.to_string(), is_cut }
}

fn of_schema(what: String) -> BatchError {
    BatchError { offset: 0, frame: 0, batch: None, what, is_cut: false }
}

fn schema(frame: &Frame) -> Result<Schema, String> {
    let message = frame.message().map_err(|error| error.fault.to_string())?;
    let Some(written) = message.header_as_schema() else {
        return Err(format!("expected a schema, found a {:?}", frame.kind));
    };
    if message.version() != MetadataVersion::V5 || written.endianness() != Endianness::Little {
        return Err(format!("expected V5, little, found {:?}, {:?}", message.version(), written.endianness()));
    }
    let fields = written.fields();
    if !fields.is_some_and(|fields| fields.iter().all(|field| is_plain(&field, NESTING_MAX))) {
        return Err("expected columns of numbers, bytes, words and lists of them".to_owned());
    }
    try_fb_to_schema(written).map_err(|error| error.to_string())
}

/// Arrow's reader of schemas is held to what recordings are made of.
fn is_plain(field: &WrittenField<'_>, nesting_max: u32) -> bool {
    match field.type_type() {
        Type::Utf8 => true,
        _ if field.dictionary().is_some() => false,
        Type::Int | Type::FloatingPoint | Type::Bool => true,
        Type::LargeUtf8 | Type::Binary | Type::LargeBinary => true,
        Type::List | Type::LargeList => field
            .children()
            .is_some_and(|children| nesting_max > 0 && children.iter().all(|child| is_plain(&child, nesting_max - 1))),
        _ => false,
    }
}

fn same_columns(written: &Schema, expected: &Schema) -> Result<(), String> {
    for (i, field) in expected.fields().iter().enumerate() {
        let said = |name: &str, data_type, nullable| {
            format!("column {i} {name:?} of {data_type}{}", if nullable { " or null" } else { "" })
        };
        let wanted = || said(field.name(), field.data_type(), field.is_nullable());
        match written.fields().get(i) {
            None => return Err(format!("expected {}, found {} columns", wanted(), written.fields().len())),
            Some(found)
                if found.name() != field.name()
                    || found.data_type() != field.data_type()
                    || found.is_nullable() != field.is_nullable() =>
            {
                let found = said(found.name(), found.data_type(), found.is_nullable());
                return Err(format!("expected {}, found {found}", wanted()));
            }
            Some(_) => {}
        }
    }
    Ok(())
}

/// That all that is described lies in the body, and that no number is absurd.
fn check(version: MetadataVersion, described: &Described<'_>, body_bytes: u64, rows_max: u32) -> Result<(), String> {
    if version != MetadataVersion::V5 {
        return Err(format!("expected V5, found {version:?}"));
    }
    if described.compression().is_some() || described.variadicBufferCounts().is_some() {
        return Err("expected neither compression nor views".to_owned());
    }
    let rows = described.length();
    if !(0..=i64::from(rows_max)).contains(&rows) {
        return Err(format!("expected 0 to {rows_max} rows, found {rows}"));
    }
    for node in described.nodes().iter().flatten() {
        let values_max = i64::try_from(body_bytes.saturating_mul(8)).unwrap_or(i64::MAX);
        if !(0..=values_max).contains(&node.length()) || !(0..=node.length()).contains(&node.null_count()) {
            return Err(format!(
                "expected 0 to {values_max} values in a column, found {} of which {} are null",
                node.length(),
                node.null_count()
            ));
        }
    }
    for buffer in described.buffers().iter().flatten() {
        let (offset, bytes) = (buffer.offset(), buffer.length());
        let end = u64::try_from(offset).ok().zip(u64::try_from(bytes).ok()).and_then(|(at, n)| at.checked_add(n));
        if end.is_none_or(|end| end > body_bytes) {
            return Err(format!("expected a column within {body_bytes} bytes, found {bytes} bytes at {offset}"));
        }
    }
    Ok(())
}

/// That there are as many buffers as the columns need, each of whole values: Arrow panics on the part of one.
fn buffers_fit<'a>(described: &Described<'_>, columns: impl Iterator<Item = &'a DataType>) -> Result<(), String> {
    let mut widths = Vec::new();
    columns.for_each(|column| value_bytes(column, &mut widths));
    let buffers = described.buffers().iter().flatten().map(|buffer| buffer.length()).collect::<Vec<_>>();
    if buffers.len() != widths.len() {
        return Err(format!("expected {} buffers, found {}", widths.len(), buffers.len()));
    }
    match buffers.iter().zip(&widths).find(|(bytes, width)| **bytes % **width != 0) {
        None => Ok(()),
        Some((bytes, width)) => Err(format!("expected values of {width} bytes, found a buffer of {bytes}")),
    }
}

/// The bytes of a value in each buffer of a column: validity first, where a bit counts as a byte.
fn value_bytes(column: &DataType, widths: &mut Vec<i64>) {
    widths.push(1);
    match column {
        DataType::Utf8 | DataType::Binary => widths.extend([4, 1]),
        DataType::LargeUtf8 | DataType::LargeBinary => widths.extend([8, 1]),
        DataType::List(values) => {
            widths.push(4);
            value_bytes(values.data_type(), widths);
        }
        DataType::LargeList(values) => {
            widths.push(8);
            value_bytes(values.data_type(), widths);
        }
        DataType::Dictionary(keys, _) => widths.push(width(keys)),
        number => widths.push(width(number)),
    }
}

fn width(number: &DataType) -> i64 {
    number.primitive_width().map_or(1, |bytes| bytes as i64)
}
