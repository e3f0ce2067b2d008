//! Least recently used.

use super::store::Order;
use crate::hardware::replacement::queues::Queues;

/// A queue in order of use.
pub(super) struct Lru(Queues);

impl Lru {
    pub(super) fn new(objects: u32) -> Self {
        Self(Queues::new(1, objects))
    }
}

impl Order for Lru {
    fn hit(&mut self, object: u32, _next_use: u32) {
        self.0.remove(0, object);
        self.0.push(0, object);
    }

    fn evict(&mut self) -> Option<u32> {
        self.0.pop(0)
    }

    fn insert(&mut self, object: u32, _next_use: u32) {
        self.0.push(0, object);
    }
}
