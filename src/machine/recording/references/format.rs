//! The columns of recorded references. docs/recording.md explains each.

use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray, ListArray, RecordBatch, UInt32Array, UInt64Array};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef};

use crate::recording::metadata;
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use trace::database::Layout;

/// The newest. Raised when a column or a word changes its meaning; a column added at the end does not raise it.
pub const FORMAT_VERSION: u32 = metadata::FORMAT_VERSION;

/// The file of a node process.
pub fn file_name(node: NodeId, epoch: Epoch) -> String {
    format!("references-n{:03}-e{}.arrows", node.0, epoch.0)
}

/// A row: some words of the stream of one tile.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Part<'a> {
    pub(super) tile: TileId,
    pub(super) attempt: Attempt,
    /// From 0 in each tile and attempt.
    pub(super) part: u32,
    /// Of the last part: the primitive tests that the tracer counted in the tile.
    pub(super) primitive_tests: Option<u64>,
    /// At least one.
    pub(super) words: &'a [u32],
}

impl Part<'_> {
    fn crc32c(&self) -> u32 {
        let (is_last, tests) = (self.primitive_tests.is_some(), self.primitive_tests.unwrap_or(0));
        row_crc32c(crc32c::crc32c(bytemuck::cast_slice(self.words)), self.tile, self.attempt, self.part, is_last, tests)
    }
}

/// A row's checksum, from that of its words: a row that is taken for another one is noticed too.
pub(super) fn row_crc32c(
    words_crc32c: u32,
    tile: TileId,
    attempt: Attempt,
    part: u32,
    is_last: bool,
    primitive_tests: u64,
) -> u32 {
    let numbers = [tile.0, attempt.0, part, u32::from(is_last)].map(u32::to_le_bytes);
    let crc32c = crc32c::crc32c_append(words_crc32c, numbers.as_flattened());
    crc32c::crc32c_append(crc32c, &primitive_tests.to_le_bytes())
}

/// The columns up to the words.
pub(super) const COLUMNS: [&str; 7] = ["tile", "attempt", "part", "is_last", "primitive_tests", "crc32c", "references"];

/// The schema, without what it says of one recording.
pub(super) fn columns() -> Schema {
    let [tile, attempt, part, is_last, tests, crc32c, references] = COLUMNS;
    let always = |column: &str, data_type| Field::new(column, data_type, false);
    Schema::new(vec![
        always(tile, DataType::UInt32),
        always(attempt, DataType::UInt32),
        always(part, DataType::UInt32),
        always(is_last, DataType::Boolean),
        always(tests, DataType::UInt64),
        always(crc32c, DataType::UInt32),
        always(references, DataType::List(word())),
    ])
}

pub(super) fn schema(node: NodeId, epoch: Epoch, layout: &Layout) -> SchemaRef {
    let own = [("marti.format", "references".to_owned()), ("marti.node", node.0.to_string())];
    Arc::new(columns().with_metadata(metadata::entries(epoch, layout, own)))
}

fn word() -> Arc<Field> {
    Arc::new(Field::new("word", DataType::UInt32, false))
}

/// A batch of the one row.
///
/// # Errors
/// Never for parts of this program; arrow checks that columns and schema agree.
pub(super) fn batch(schema: &SchemaRef, part: &Part) -> Result<RecordBatch, ArrowError> {
    let u32s = |value| -> ArrayRef { Arc::new(UInt32Array::from_value(value, 1)) };
    let words = UInt32Array::from(part.words.to_vec());
    let offsets = arrow_buffer::OffsetBuffer::from_lengths([part.words.len()]);
    let columns: Vec<ArrayRef> = vec![
        u32s(part.tile.0),
        u32s(part.attempt.0),
        u32s(part.part),
        Arc::new(BooleanArray::from(vec![part.primitive_tests.is_some()])),
        Arc::new(UInt64Array::from_value(part.primitive_tests.unwrap_or(0), 1)),
        u32s(part.crc32c()),
        Arc::new(ListArray::try_new(word(), offsets, Arc::new(words), None)?),
    ];
    RecordBatch::try_new(Arc::clone(schema), columns)
}
