//! The bus process: cluster memory, arbitration, and the log of both.
