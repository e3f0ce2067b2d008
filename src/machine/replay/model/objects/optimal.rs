//! Belady's policy: the object whose next request is the last.

use super::store::Order;
use super::{Requests, unknown};
use crate::replay::TraceError;

/// An object that is not requested again.
pub(super) const NEVER: u32 = u32::MAX;

/// By request, the number of the next one for the same object, counted from 0; [`NEVER`] if there is none.
///
/// # Errors
/// The trace's; an object's number is not below `objects`; 2³² − 1 requests or more.
pub(super) fn next_uses(requests: &(impl Requests + ?Sized), objects: u32) -> Result<Vec<u32>, TraceError> {
    // By object, its last request.
    let mut last = vec![NEVER; objects as usize];
    let mut next = Vec::new();
    requests.for_each_piece(&mut |piece| {
        for request in piece {
            let Some(last) = last.get_mut(request.object as usize) else {
                return Err(unknown(request.object, objects));
            };
            let number = next.len() as u32;
            if number == NEVER {
                return Err(TraceError(format!(
                    "more requests than optimal replacement takes: expected at most {}",
                    NEVER - 1
                )));
            }
            if *last != NEVER {
                next[*last as usize] = number;
            }
            *last = number;
            next.push(NEVER);
        }
        Ok(())
    })?;
    Ok(next)
}

/// A binary heap of the objects in the cache, the one whose next use is the last at its top.
///
/// Of several objects that are never used again any may be evicted. Which one is, decides how much room there is, and so how many
/// misses are counted where sizes differ: the heap is libCacheSim's, step by step (its pqueue.c), and has the same one at its top.
pub(super) struct Optimal {
    heap: Vec<u32>,
    /// By object, its place in the heap.
    places: Vec<u32>,
    /// By object.
    next_uses: Vec<u32>,
}

impl Optimal {
    pub(super) fn new(objects: u32) -> Self {
        Self { heap: Vec::new(), places: vec![0; objects as usize], next_uses: vec![NEVER; objects as usize] }
    }

    fn next_use(&self, place: usize) -> u32 {
        self.next_uses[self.heap[place] as usize]
    }

    fn put(&mut self, place: usize, object: u32) {
        self.heap[place] = object;
        self.places[object as usize] = place as u32;
    }

    fn up(&mut self, mut place: usize) {
        let object = self.heap[place];
        let next_use = self.next_uses[object as usize];
        while place > 0 && self.next_use((place - 1) / 2) < next_use {
            self.put(place, self.heap[(place - 1) / 2]);
            place = (place - 1) / 2;
        }
        self.put(place, object);
    }

    fn down(&mut self, mut place: usize) {
        let object = self.heap[place];
        let next_use = self.next_uses[object as usize];
        while let Some(child) = self.later_child(place)
            && next_use < self.next_use(child)
        {
            self.put(place, self.heap[child]);
            place = child;
        }
        self.put(place, object);
    }

    /// The second child only if it is used later than the first.
    fn later_child(&self, place: usize) -> Option<usize> {
        let (first, second) = (2 * place + 1, 2 * place + 2);
        if first >= self.heap.len() {
            return None;
        }
        let is_later = second < self.heap.len() && self.next_use(first) < self.next_use(second);
        Some(if is_later { second } else { first })
    }
}

impl Order for Optimal {
    fn hit(&mut self, object: u32, next_use: u32) {
        let before = std::mem::replace(&mut self.next_uses[object as usize], next_use);
        let place = self.places[object as usize] as usize;
        if before < next_use {
            self.up(place);
        } else {
            self.down(place);
        }
    }

    fn evict(&mut self) -> Option<u32> {
        if self.heap.is_empty() {
            return None;
        }
        let top = self.heap.swap_remove(0);
        if !self.heap.is_empty() {
            self.down(0);
        }
        Some(top)
    }

    fn insert(&mut self, object: u32, next_use: u32) {
        self.next_uses[object as usize] = next_use;
        self.heap.push(object);
        self.up(self.heap.len() - 1);
    }
}
