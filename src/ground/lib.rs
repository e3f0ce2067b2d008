//! What every layer rests on: whole files, the outlet for text, the floating-point environment.

pub mod atomic_file;
pub mod colour;
pub mod floating_point;
pub mod ids;
pub mod interruption;
pub mod outlet;
pub mod patient_file;
pub mod processor_time;
pub mod progress;
pub mod pulse;
pub mod regular_file;
pub mod role_program;
pub mod secret_file;
pub mod telemetry;
