//! What renders together: topologies, keys, the typed protocol, the journal, reports, and the processes.

pub mod chaos;
pub mod journal;
pub mod keys;
pub mod processes;
pub mod protocol;
pub mod report;
pub mod topology;
