//! First in, first out.

use super::store::Order;
use crate::hardware::replacement::queues::Queues;

/// A queue in order of placement.
pub(super) struct Fifo(Queues);

impl Fifo {
    pub(super) fn new(objects: u32) -> Self {
        Self(Queues::new(1, objects))
    }
}

impl Order for Fifo {
    fn hit(&mut self, _object: u32, _next_use: u32) {}

    fn evict(&mut self) -> Option<u32> {
        self.0.pop(0)
    }

    fn insert(&mut self, object: u32, _next_use: u32) {
        self.0.push(0, object);
    }
}
