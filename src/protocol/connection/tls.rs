//! Mutual TLS 1.3 under a connection.

/// What one process proves itself with, and by what it judges others. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Tls {}
