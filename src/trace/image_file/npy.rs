//! NumPy's NPY format, version 1.0 (numpy.lib.format): a magic, a header of Python literals padded so that the
//! data start on a multiple of 64 bytes, and the array in C order.

use std::io::{self, Write};

use bytemuck::Pod;

/// A number type that NumPy knows.
pub(super) trait Element: Pod {
    /// NumPy's name for it, little-endian.
    const DESCR: &'static str;
}

impl Element for f32 {
    const DESCR: &'static str = "<f4";
}

impl Element for i32 {
    const DESCR: &'static str = "<i4";
}

/// Writes an array of that shape, whose product is the number of elements.
pub(super) fn write<T: Element>(out: &mut impl Write, shape: &[usize], elements: &[T]) -> io::Result<()> {
    debug_assert_eq!(shape.iter().product::<usize>(), elements.len());
    let sides: Vec<_> = shape.iter().map(usize::to_string).collect();
    let mut header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}", T::DESCR, sides.join(", "));
    // Magic, version and header length take 10 bytes; the header ends with a newline.
    let padded = (10 + header.len() + 1).next_multiple_of(64) - 10;
    header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&u16::try_from(header.len()).map_err(io::Error::other)?.to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    out.write_all(bytemuck::cast_slice(elements))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bytes_are_those_numpy_writes() {
        let mut bytes = Vec::new();
        write(&mut bytes, &[2, 3], &[1i32, 2, 3, 4, 5, -1]).expect("into memory");
        // numpy.save of the same array: a header of 118 bytes, the data from byte 128 on.
        assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\x76\x00");
        assert!(bytes[10..].starts_with(b"{'descr': '<i4', 'fortran_order': False, 'shape': (2, 3), }     "));
        assert_eq!(bytes[127], b'\n');
        assert_eq!(&bytes[128..132], &[1, 0, 0, 0]);
        assert_eq!(&bytes[148..], &[0xff; 4]);
    }
}
