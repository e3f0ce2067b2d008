//! Clock, or second chance: an object that was requested again goes round once more.

use super::store::Order;
use crate::hardware::replacement::queues::Queues;

/// A queue whose first object goes to the end and loses its mark while it has one.
pub(super) struct Clock {
    queue: Queues,
    /// By object.
    referenced: Vec<bool>,
    /// Whether an object has its mark when it is placed.
    begins_referenced: bool,
}

impl Clock {
    pub(super) fn new(objects: u32, begins_referenced: bool) -> Self {
        Self { queue: Queues::new(1, objects), referenced: vec![false; objects as usize], begins_referenced }
    }
}

impl Order for Clock {
    fn hit(&mut self, object: u32, _next_use: u32) {
        self.referenced[object as usize] = true;
    }

    fn evict(&mut self) -> Option<u32> {
        loop {
            let object = self.queue.pop(0)?;
            if !std::mem::take(&mut self.referenced[object as usize]) {
                return Some(object);
            }
            self.queue.push(0, object);
        }
    }

    fn insert(&mut self, object: u32, _next_use: u32) {
        self.referenced[object as usize] = self.begins_referenced;
        self.queue.push(0, object);
    }
}
