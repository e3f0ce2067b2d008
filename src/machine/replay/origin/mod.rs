//! Where misses come from: sections, levels, kinds of rays, and pixels.

pub mod heat_map;
pub mod origins;
pub mod pixels;
