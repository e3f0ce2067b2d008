//! A processing node: local memory and tracer.
