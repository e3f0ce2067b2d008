//! SIEVE, as [`crate::hardware::replacement::Sieve`] has it for lines.

use super::store::Order;
use crate::hardware::replacement::queues::Queues;

/// A queue in order of placement, and a hand that goes over it from the oldest object to the newest.
pub(super) struct Sieve {
    queue: Queues,
    /// By object, whether it was hit since the hand last passed.
    visited: Vec<bool>,
    /// The object under the hand; `None`: the oldest one.
    hand: Option<u32>,
}

impl Sieve {
    pub(super) fn new(objects: u32) -> Self {
        Self { queue: Queues::new(1, objects), visited: vec![false; objects as usize], hand: None }
    }
}

impl Order for Sieve {
    fn hit(&mut self, object: u32, _next_use: u32) {
        self.visited[object as usize] = true;
    }

    fn evict(&mut self) -> Option<u32> {
        let oldest = self.queue.oldest(0)?;
        let mut object = self.hand.unwrap_or(oldest);
        while std::mem::take(&mut self.visited[object as usize]) {
            object = self.queue.newer(object).unwrap_or(oldest);
        }
        self.hand = self.queue.newer(object);
        self.queue.remove(0, object);
        Some(object)
    }

    fn insert(&mut self, object: u32, _next_use: u32) {
        self.visited[object as usize] = false;
        self.queue.push(0, object);
    }
}
