//! The output folder, and what is written into it at the end of a run that records references.

pub(super) mod output_folder;
pub(super) mod recorded;
