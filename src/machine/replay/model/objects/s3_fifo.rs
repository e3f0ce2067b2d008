//! S3-FIFO, as [`crate::hardware::replacement::S3Fifo`] has it for lines, with queues that are measured in bytes.

use super::store::Cache;
use super::{ObjectCounters, Request};
use crate::hardware::replacement::queues::Queues;
use crate::hardware::replacement::s3_fifo::{FREQUENCY_MAX, GHOST_SHARE, HITS_TO_MAIN, SMALL_SHARE};

/// A small queue of a tenth of the bytes, a main queue of the rest, and a ghost queue that remembers objects of nine tenths.
///
/// As in libCacheSim's S3FIFO.c, only objects that are smaller than the small queue are placed in it: no other is ever placed.
/// For one that is exactly as large as the small queue, objects are evicted all the same (S3FIFO.c:481 of its revision aa0fc40
/// admits it, S3FIFO.c:284 does not place it). A cache of fewer than 10 bytes, with which
/// libCacheSim ends with an error, has no small queue and places nothing but what has no bytes.
pub(super) struct S3Fifo {
    capacity: u64,
    /// By queue, bytes at most. Of the main queue this is exceeded, and decides from which of the two is evicted.
    limits: [u64; QUEUES],
    /// By queue.
    occupied: [u64; QUEUES],
    /// By object, the queue that it is in, or [`NOWHERE`].
    places: Vec<u8>,
    /// By object, as it was placed.
    bytes: Vec<u64>,
    /// By object, hits since it came into its queue, up to [`FREQUENCY_MAX`].
    frequency: Vec<u8>,
    queues: Queues,
    has_evicted: bool,
}

const SMALL: u8 = 0;
const MAIN: u8 = 1;
const GHOST: u8 = 2;
const QUEUES: usize = 3;
const NOWHERE: u8 = QUEUES as u8;

impl S3Fifo {
    pub(super) fn new(capacity: u64, objects: u32) -> Self {
        // As libCacheSim rounds: in f64, then down.
        let share = |share: f64| (capacity as f64 * share) as u64;
        let small = share(SMALL_SHARE);
        Self {
            capacity,
            limits: [small, capacity - small, share(GHOST_SHARE)],
            occupied: [0; QUEUES],
            places: vec![NOWHERE; objects as usize],
            bytes: vec![0; objects as usize],
            frequency: vec![0; objects as usize],
            queues: Queues::new(QUEUES as u32, objects),
            has_evicted: false,
        }
    }

    /// Whether the object was in the cache.
    fn request(&mut self, Request { object, bytes }: Request) -> bool {
        let place = self.places[object as usize];
        if place == SMALL || place == MAIN {
            let frequency = &mut self.frequency[object as usize];
            *frequency = (*frequency + 1).min(FREQUENCY_MAX);
            return true;
        }
        let is_remembered = place == GHOST;
        if is_remembered {
            self.take(object);
        }
        if bytes > self.limits[SMALL as usize] {
            return false;
        }
        while self.capacity - self.occupied[SMALL as usize] - self.occupied[MAIN as usize] < bytes {
            self.evict();
        }
        if is_remembered {
            self.place(MAIN, object, bytes);
        } else if bytes < self.limits[SMALL as usize] {
            let is_full = self.occupied[SMALL as usize] >= self.limits[SMALL as usize];
            let queue = if !self.has_evicted && is_full { MAIN } else { SMALL };
            self.place(queue, object, bytes);
        }
        false
    }

    fn place(&mut self, queue: u8, object: u32, bytes: u64) {
        self.places[object as usize] = queue;
        self.bytes[object as usize] = bytes;
        self.frequency[object as usize] = 0;
        self.occupied[queue as usize] += bytes;
        self.queues.push(u32::from(queue), object);
    }

    /// Takes an object out of its queue.
    fn take(&mut self, object: u32) {
        let queue = std::mem::replace(&mut self.places[object as usize], NOWHERE);
        self.occupied[queue as usize] -= self.bytes[object as usize];
        self.queues.remove(u32::from(queue), object);
    }

    /// Evicts an object, or moves all of the small queue into the main one.
    fn evict(&mut self) {
        self.has_evicted = true;
        if self.occupied[MAIN as usize] > self.limits[MAIN as usize] || self.occupied[SMALL as usize] == 0 {
            self.evict_from_main();
        } else {
            self.evict_from_small();
        }
    }

    fn evict_from_small(&mut self) {
        while self.occupied[SMALL as usize] > 0
            && let Some(object) = self.queues.oldest(u32::from(SMALL))
        {
            self.take(object);
            let bytes = self.bytes[object as usize];
            if self.frequency[object as usize] < HITS_TO_MAIN {
                self.remember(object, bytes);
                return;
            }
            self.place(MAIN, object, bytes);
        }
    }

    fn evict_from_main(&mut self) {
        while self.occupied[MAIN as usize] > 0
            && let Some(object) = self.queues.oldest(u32::from(MAIN))
        {
            self.take(object);
            let frequency = self.frequency[object as usize];
            if frequency == 0 {
                return;
            }
            self.place(MAIN, object, self.bytes[object as usize]);
            self.frequency[object as usize] = frequency - 1;
        }
    }

    fn remember(&mut self, object: u32, bytes: u64) {
        let limit = self.limits[GHOST as usize];
        if bytes > limit {
            return;
        }
        while limit - self.occupied[GHOST as usize] < bytes
            && let Some(oldest) = self.queues.oldest(u32::from(GHOST))
        {
            self.take(oldest);
        }
        self.place(GHOST, object, bytes);
    }
}

impl Cache for S3Fifo {
    fn requests(&mut self, piece: &[Request], _next_uses: &[u32], counters: &mut ObjectCounters) {
        for &request in piece {
            let hit = self.request(request);
            counters.count(request, hit);
        }
    }
}
