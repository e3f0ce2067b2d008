//! An image as it is asked for and cut into tiles, and the pixels of a part of it.

mod pixels;
mod settings;
mod terminator;
mod tiling;

pub use pixels::{AovSet, Pixels};
pub use settings::{ImageSettings, ImageSettingsError};
pub use terminator::Terminator;
pub use tiling::{Rect, Sides, Tiling, TilingError};
