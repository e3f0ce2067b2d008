//! Which objects are in a cache, and how many bytes they are, for all policies that admit every object that fits.

use super::{ObjectCounters, Request};

/// A cache of objects with any policy.
pub(super) trait Cache {
    /// Requests objects and counts. `next_uses` has the number of each one's next request, or is empty.
    fn requests(&mut self, piece: &[Request], next_uses: &[u32], counters: &mut ObjectCounters);
}

/// A policy: the order in which the objects of a cache are evicted.
pub(super) trait Order {
    /// An object of the cache was requested; `next_use` is the number of its next request.
    fn hit(&mut self, object: u32, next_use: u32);

    /// Takes out the object that is evicted. `None`: there is none.
    fn evict(&mut self) -> Option<u32>;

    /// An object was placed.
    fn insert(&mut self, object: u32, next_use: u32);
}

/// A cache that evicts in the order of `O`.
pub(super) struct Store<O> {
    capacity: u64,
    /// Bytes of the objects that are in the cache.
    occupied: u64,
    /// By object: its bytes as it was placed, [`ABSENT`] if it is not in the cache.
    bytes: Vec<u64>,
    order: O,
}

/// No object is placed that is as large: it could fill all of a cache, and no other would fit beside it, were there such memories.
const ABSENT: u64 = u64::MAX;

impl<O: Order> Store<O> {
    pub(super) fn new(capacity: u64, objects: u32, order: O) -> Self {
        // An object of 2⁶⁴ − 1 bytes is absent, and is not placed.
        Self { capacity: capacity.min(ABSENT - 1), occupied: 0, bytes: vec![ABSENT; objects as usize], order }
    }

    /// Whether the object was in the cache.
    #[inline]
    fn request(&mut self, Request { object, bytes }: Request, next_use: u32) -> bool {
        if self.bytes[object as usize] != ABSENT {
            self.order.hit(object, next_use);
            return true;
        }
        if bytes > self.capacity {
            return false;
        }
        while self.capacity - self.occupied < bytes {
            let Some(evicted) = self.order.evict() else { break };
            self.occupied -= std::mem::replace(&mut self.bytes[evicted as usize], ABSENT);
        }
        self.bytes[object as usize] = bytes;
        self.occupied += bytes;
        self.order.insert(object, next_use);
        false
    }
}

impl<O: Order> Cache for Store<O> {
    fn requests(&mut self, piece: &[Request], next_uses: &[u32], counters: &mut ObjectCounters) {
        for (i, &request) in piece.iter().enumerate() {
            let hit = self.request(request, next_uses.get(i).copied().unwrap_or(u32::MAX));
            counters.count(request, hit);
        }
    }
}

impl ObjectCounters {
    /// Sums of bytes end at 2⁶⁴ − 1.
    #[inline]
    pub(super) fn count(&mut self, request: Request, hit: bool) {
        self.requests += 1;
        self.bytes_requested = self.bytes_requested.saturating_add(request.bytes);
        if !hit {
            self.misses += 1;
            self.bytes_missed = self.bytes_missed.saturating_add(request.bytes);
        }
    }
}
