//! Compressed traces, as gzip 1.12, zstd 1.5 and xz 5.4 write them.

use std::io::Write;

use super::{of_format, recognised};
use crate::replay::importers::ImportFormat::Din;
use crate::replay::importers::compression::Compression;

const PLAIN: &[u8] = b"0 40\n1 80\n2 c0\n3 100\n";
const GZIP: &[u8] = b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x02\x03\x33\x50\x30\x31\xe0\x32\x54\xb0\x30\xe0\x32\x52\x48\x36\xe0\x32\x56\x30\x34\x30\xe0\x02\x00\xf8\xd3\x8f\xd3\x15\x00\x00\x00";
const ZSTD: &[u8] = b"\x28\xb5\x2f\xfd\x04\x58\xa9\x00\x00\x30\x20\x34\x30\x0a\x31\x20\x38\x30\x0a\x32\x20\x63\x30\x0a\x33\x20\x31\x30\x30\x0a\x27\xb0\xae\x25";
const XZ: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x04\xe6\xd6\xb4\x46\x02\x00\x21\x01\x16\x00\x00\x00\x74\x2f\xe5\xa3\x01\x00\x14\x30\x20\x34\x30\x0a\x31\x20\x38\x30\x0a\x32\x20\x63\x30\x0a\x33\x20\x31\x30\x30\x0a\x00\x00\x00\x00\x0c\xa3\xa8\x51\x63\x64\xe0\xc4\x00\x01\x2d\x15\x2f\x0b\x71\x6d\x1f\xb6\xf3\x7d\x01\x00\x00\x00\x00\x04\x59\x5a";
/// `0 140`, a line.
const GZIP_NEXT: &[u8] =
    b"\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03\x33\x50\x30\x34\x31\xe0\x02\x00\x6f\x84\x1f\x20\x06\x00\x00\x00";
const ZSTD_NEXT: &[u8] = b"\x28\xb5\x2f\xfd\x04\x58\x31\x00\x00\x30\x20\x31\x34\x30\x0a\x86\xfb\xa3\x11";
/// With a check by SHA-256.
const XZ_NEXT: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x0a\xe1\xfb\x0c\xa1\x02\x00\x21\x01\x16\x00\x00\x00\x74\x2f\xe5\xa3\x01\x00\x05\x30\x20\x31\x34\x30\x0a\x00\x00\x00\x05\xb3\xd2\x2d\x04\xeb\x07\xcd\xe0\xfc\x36\x90\x8d\xef\xe9\xe4\xb9\x95\x65\xc5\xd4\xd7\xde\x05\x40\xc4\xb7\x45\x29\xfd\x5d\xcc\x00\x01\x36\x06\x6b\x81\xf9\x40\x18\x9b\x4b\x9a\x01\x00\x00\x00\x00\x0a\x59\x5a";
/// A frame that is to be left out.
const ZSTD_SKIPPABLE: &[u8] = b"\x5a\x2a\x4d\x18\x03\x00\x00\x00abc";
/// `zstd --ultra -22 --long=31` and `xz --lzma2=dict=1GiB` of the same text.
const ZSTD_LONG: &[u8] = b"\x28\xb5\x2f\xfd\x04\xa8\xa9\x00\x00\x30\x20\x34\x30\x0a\x31\x20\x38\x30\x0a\x32\x20\x63\x30\x0a\x33\x20\x31\x30\x30\x0a\x27\xb0\xae\x25";
const XZ_LARGE: &[u8] = b"\xfd\x37\x7a\x58\x5a\x00\x00\x04\xe6\xd6\xb4\x46\x02\x00\x21\x01\x24\x00\x00\x00\x5e\x1f\xc7\xf9\x01\x00\x14\x30\x20\x34\x30\x0a\x31\x20\x38\x30\x0a\x32\x20\x63\x30\x0a\x33\x20\x31\x30\x30\x0a\x00\x00\x00\x00\x0c\xa3\xa8\x51\x63\x64\xe0\xc4\x00\x01\x2d\x15\x2f\x0b\x71\x6d\x1f\xb6\xf3\x7d\x01\x00\x00\x00\x00\x04\x59\x5a";

const ALL: [(Compression, &[u8], &[u8]); 3] =
    [(Compression::Gzip, GZIP, GZIP_NEXT), (Compression::Zstd, ZSTD, ZSTD_NEXT), (Compression::Xz, XZ, XZ_NEXT)];

fn references(bytes: &[u8]) -> Result<u64, String> {
    of_format(Din, bytes).map(|imported| imported.notes().references)
}

#[test]
fn what_is_compressed_is_recognised_and_read() {
    assert_eq!((Compression::of(PLAIN), references(PLAIN)), (None, Ok(4)));
    for (compression, bytes, next) in ALL {
        assert_eq!(Compression::of(bytes), Some(compression));
        assert_eq!(references(bytes), Ok(4), "{compression:?}");
        let several = [bytes, next, bytes].concat();
        assert_eq!(references(&several), Ok(9), "{compression:?}");
        let name = format!("x.din.{}", ["gz", "zst", "xz"][compression as usize]);
        assert_eq!(recognised(&name, bytes).expect("by its name").notes().references, 4);
    }
    assert_eq!(references(&[ZSTD_SKIPPABLE, ZSTD, ZSTD_SKIPPABLE, ZSTD_NEXT].concat()), Ok(5));
    // Streams of xz may be filled up to a multiple of four bytes.
    assert_eq!(references(&[XZ, &[0; 8], XZ_NEXT, &[0; 4]].concat()), Ok(5));
}

#[test]
fn a_cut_stream_is_refused_wherever_it_is_cut() {
    for (compression, bytes, next) in ALL {
        let several = [bytes, next].concat();
        for end in (1..several.len()).filter(|&end| end != bytes.len()) {
            let error = references(&several[..end]).expect_err("cut");
            let is_recognised = Compression::of(&several[..end]).is_some();
            assert!(!is_recognised || error.contains("compressed stream"), "{compression:?} {end}: {error}");
        }
        assert!(references(&several[..several.len() - 1]).expect_err("cut").starts_with("f:"));
    }
    let cut = &GZIP[..30];
    assert_eq!(
        references(cut),
        Err("f: gzip: the compressed stream ends at byte 30, expected the rest of it".to_owned())
    );
}

#[test]
fn a_changed_bit_is_found_or_means_nothing() {
    for (compression, bytes, _) in ALL {
        for bit in 0..bytes.len() * 8 {
            let mut changed = bytes.to_vec();
            changed[bit / 8] ^= 1 << (bit % 8);
            if Compression::of(&changed) == Some(compression) {
                // Such as the time in a header of gzip.
                let read = references(&changed);
                assert!(read.is_err() || read == Ok(4), "{compression:?} bit {bit}: {read:?}");
            }
        }
    }
}

#[test]
fn what_follows_a_stream_is_refused() {
    for (compression, bytes, _) in ALL {
        let error = references(&[bytes, b"0 40\n0 40\n0 40\n"].concat()).expect_err("no stream");
        assert!(error.contains("compressed stream"), "{compression:?}: {error}");
    }
}

#[test]
fn a_window_that_is_too_large_is_refused_before_it_is_made() {
    let error = references(ZSTD_LONG).expect_err("2 GiB");
    assert!(error.starts_with("f: zstd: byte 6 of the compressed stream: ") && error.contains("2147483648"), "{error}");
    let error = references(XZ_LARGE).expect_err("1 GiB");
    assert!(error.starts_with("f: xz: byte 24 of the compressed stream: ") && error.contains("limit"), "{error}");
}

#[test]
fn a_fault_far_in_a_stream_has_the_line_that_it_comes_at() {
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    for i in 0..200_000u64 {
        writeln!(gzip, "0 {:x}", i.wrapping_mul(0x9e37_79b9_7f4a_7c15)).expect("into memory");
    }
    let bytes = gzip.finish().expect("into memory");
    assert_eq!(references(&bytes), Ok(200_000));
    let error = references(&bytes[..bytes.len() / 2]).expect_err("cut");
    let end = format!(":1: gzip: the compressed stream ends at byte {}, expected the rest of it", bytes.len() / 2);
    let line: u64 =
        error.strip_prefix("f:").and_then(|rest| rest.strip_suffix(&end)).expect(&error).parse().expect(&error);
    assert!((90_000..110_000).contains(&line), "{error}");
}

#[test]
fn a_frame_has_as_many_bytes_as_it_says() {
    // One raw block of five bytes; the byte before it is the size of the frame's content.
    let frame = |size: u8| [b"\x28\xb5\x2f\xfd\x20", &[size][..], b"\x29\x00\x00", b"0 40\n"].concat();
    assert_eq!(references(&frame(5)), Ok(1));
    let error = references(&frame(6)).expect_err("a lie");
    assert!(error.contains("a frame of 5 bytes, expected 6 as it says"), "{error}");
}
