//! A trace that is small enough to be written out by hand.

use std::io::Cursor;

use super::accesses::Surroundings;
use super::*;
use crate::hardware::references::RecordNumbers;
use crate::replay::{Captured, RecordLines};
use ground::ids::{NodeId, TileId};
use trace::database::{Layout, Section};
use trace::picture::{Sides, Tiling};
use trace::tracer::RayKind;

/// Two tiles of an image of 3×2, of which the second was traced by node 1 in two parts.
fn example() -> (Layout, Captured) {
    // Octree words from 0 on (64 bytes in a granule of 256), triangles of 40 bytes from 256 on.
    let layout = Layout::new([16, 0, 4, 0, 0, 0, 0, 0, 0]).expect("small");
    let numbers = RecordNumbers::new(&layout);
    let octree = |index| ReferenceWord::read(numbers.number(Section::OctreeNodes, index)).0;
    let triangle = |index| ReferenceWord::read(numbers.number(Section::Triangles, index)).0;
    let ray = |kind| ReferenceWord::ray(kind).0;
    let mut trace = Captured::default();
    let first = vec![ray(RayKind::Primary), octree(0), octree(9), triangle(1), ray(RayKind::Shadow), octree(0)];
    trace.push(NodeId(0), TileId(0), [first]);
    let second = [vec![ray(RayKind::Primary), octree(0)], vec![ray(RayKind::Primary), triangle(3)]];
    trace.push(NodeId(1), TileId(1), second);
    (layout, trace)
}

const TILING: Tiling = Tiling::new(Sides { width: 3, height: 2, tile_width: 2, tile_height: 2 }).expect("possible");

fn text(write: impl FnOnce(&mut Vec<u8>) -> Result<u64, ExportError>) -> (u64, String) {
    let mut out = Vec::new();
    let count = write(&mut out).expect("into memory");
    (count, String::from_utf8(out).expect("text"))
}

#[test]
fn din_by_hand() {
    let (layout, trace) = example();
    // Triangle 1 is in bytes 296 to 335: lines of 32 bytes from 0x120 and 0x140. Octree word 9 is in byte 36.
    let (count, text) = text(|out| din::write(out, &trace, &[0], &RecordLines::new(&layout, 32), 32));
    assert_eq!((count, text.as_str()), (5, "0 0\n0 20\n0 120\n0 140\n0 0\n"));
}

#[test]
fn oracle_general_by_hand() {
    let (layout, trace) = example();
    let mut out = Cursor::new(Vec::new());
    // After something that is in the file already.
    out.set_position(3);
    let count = oracle_general::write(&mut out, &trace, &[0, 1], &RecordLines::new(&layout, 32), 32).expect("written");
    // Triangle 3 is in bytes 376 to 415: lines 11 and 12.
    let expected: [(u32, u64, i64); 8] =
        [(0, 0, 5), (0, 1, -1), (0, 9, -1), (0, 10, -1), (0, 0, 6), (1, 0, -1), (1, 11, -1), (1, 12, -1)];
    let mut bytes = vec![0; 3];
    for (time, object, next) in expected {
        bytes.extend(time.to_le_bytes());
        bytes.extend(object.to_le_bytes());
        bytes.extend(32u32.to_le_bytes());
        bytes.extend(next.to_le_bytes());
    }
    assert_eq!((count, out.position()), (8, bytes.len() as u64));
    assert_eq!(out.into_inner(), bytes);
}

#[test]
fn csv_and_json_by_hand() {
    let (layout, trace) = example();
    let surroundings = Surroundings { layout: &layout, levels: &[0, 1], tiling: TILING };
    let (count, rows) = text(|out| csv::write(out, &trace, &[0, 1], surroundings));
    let expected = "\
node,tile,attempt,x,y,ray,section,level,record,address,bytes
0,0,0,0,0,primary,octree_nodes,0,0,0,4
0,0,0,0,0,primary,octree_nodes,1,9,36,4
0,0,0,0,0,primary,triangles,,1,296,40
0,0,0,0,0,shadow,octree_nodes,0,0,0,4
1,1,0,2,0,primary,octree_nodes,0,0,0,4
1,1,0,2,1,primary,triangles,,3,376,40
";
    assert_eq!((count, rows.as_str()), (6, expected));

    let (count, objects) = text(|out| json::write(out, &trace, &[0, 1], surroundings));
    assert_eq!(count, 6);
    let mut lines = expected.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    for (row, object) in lines.zip(objects.lines()) {
        let object: serde_json::Value = serde_json::from_str(object).expect("JSON");
        let fields: Vec<String> = names
            .iter()
            .map(|&name| match &object[name] {
                serde_json::Value::Null => String::new(),
                serde_json::Value::String(text) => text.clone(),
                other => other.to_string(),
            })
            .collect();
        assert_eq!(fields.join(","), row);
    }
}

#[test]
fn what_a_trace_must_not_hold_is_an_error() {
    let (layout, mut trace) = example();
    let lines = RecordLines::new(&layout, 32);
    let surroundings = Surroundings { layout: &layout, levels: &[], tiling: TILING };
    for (word, what) in [(0xc300_0000, "0xc3000000 is no word"), (5000, "record 5000")] {
        trace.parts[0][1] = word;
        let outcomes = [
            din::write(&mut Vec::new(), &trace, &[0], &lines, 32),
            oracle_general::write(&mut Cursor::new(Vec::new()), &trace, &[0], &lines, 32),
            csv::write(&mut Vec::new(), &trace, &[0], surroundings),
            json::write(&mut Vec::new(), &trace, &[0], surroundings),
        ];
        for outcome in outcomes {
            let error = outcome.expect_err("a bad word").to_string();
            assert!(error.contains(what), "{error}");
        }
    }
}
