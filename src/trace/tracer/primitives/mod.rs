//! Ray and primitive intersection: one function a kind, in f64 over the f32 records, so that `t` does not
//! depend on who asks. No fused multiply-add anywhere.

pub mod cone;
pub mod exact;
pub mod four_triangles;
pub mod sphere;
pub mod triangle;
pub mod whole_numbers;
