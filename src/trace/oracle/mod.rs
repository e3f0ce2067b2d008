//! The oracle: what a ray hits, found without the octree and without the tracer's decisions. Slow and exact; the
//! tracer is held against it by tests and by `marti verify`. All that both share is how to add without rounding.
//!
//! It reads the rounded records of a database and takes the rounded ray, both exact in f64: how far rounding moved
//! a surface is not its question.

pub mod brute_force;
pub mod closed_mesh;
pub mod curved;
pub mod determinant;
pub mod kernels;
pub mod rays;
pub mod triangle;
pub mod verification;

pub use brute_force::{Answer, BruteForce, Verdict};
pub use closed_mesh::ClosedMesh;
pub use kernels::{Kernel, KernelTracer, Subject};
pub use rays::AimedAt;
pub use verification::{KernelOutcomes, Outcomes, Verification, verify};
