//! Caches of whole objects of different sizes, such as those of files, pages and blocks: fully associative, with a capacity in
//! bytes.
//!
//! They count what libCacheSim counts (version 0.3.5 of its Python package, with `consider_obj_metadata` false, its default):
//!
//! - a request for an object that is in the cache is a hit, whatever size it asks for: the object keeps the size that it was placed with;
//! - an object that is larger than the cache is not placed, and nothing is evicted for it;
//! - otherwise objects are evicted until there is room, and the new one is placed.

mod clock;
mod fifo;
mod imported;
mod lru;
mod optimal;
mod random;
mod s3_fifo;
mod sieve;
mod store;
#[cfg(test)]
mod tests;

use serde::Serialize;

use self::clock::Clock;
use self::fifo::Fifo;
use self::lru::Lru;
use self::optimal::{Optimal, next_uses};
use self::random::Random;
use self::s3_fifo::S3Fifo;
use self::sieve::Sieve;
use self::store::{Cache, Store};
use crate::replay::TraceError;
use crate::replay::model::counts::ratio;
use crate::replay::plan::setting::Policy;

/// A request for an object.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Request {
    /// Counted from 0, without gaps: caches have tables of all objects.
    pub object: u32,
    /// Its size at this request.
    pub bytes: u64,
}

/// Requests in their order, as often as they are needed.
pub trait Requests {
    /// Calls `consume` with piece after piece, from the first request to the last, and ends with its first error.
    ///
    /// # Errors
    /// The trace's, and those of `consume`.
    fn for_each_piece(&self, consume: &mut dyn FnMut(&[Request]) -> Result<(), TraceError>) -> Result<(), TraceError>;
}

impl Requests for [Request] {
    fn for_each_piece(&self, consume: &mut dyn FnMut(&[Request]) -> Result<(), TraceError>) -> Result<(), TraceError> {
        consume(self)
    }
}

/// What a cache of objects counts.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug, Serialize)]
pub struct ObjectCounters {
    pub requests: u64,
    /// Requests for objects that were not in the cache.
    pub misses: u64,
    /// Of all requests.
    pub bytes_requested: u64,
    /// Of the requests that missed.
    pub bytes_missed: u64,
}

impl ObjectCounters {
    /// Misses per request; 0 without requests.
    pub fn object_miss_ratio(&self) -> f64 {
        ratio(self.misses, self.requests)
    }

    /// Bytes missed per byte requested; 0 without bytes.
    pub fn byte_miss_ratio(&self) -> f64 {
        ratio(self.bytes_missed, self.bytes_requested)
    }
}

/// A cache of objects that requests go through.
pub struct ObjectCache {
    cache: Box<dyn Cache + Send>,
    objects: u32,
    counters: ObjectCounters,
}

impl ObjectCache {
    /// An empty cache of so many bytes, for objects with numbers below `objects`; `seed` decides random replacement.
    ///
    /// # Errors
    /// `policy` needs lines of one size, or the future, which [`count_misses`] looks up.
    pub fn new(policy: Policy, capacity_bytes: u64, objects: u32, seed: u64) -> Result<Self, TraceError> {
        if policy == Policy::Optimal {
            let what = "optimal replacement needs all requests in advance: expected them to be counted as a whole";
            return Err(TraceError(what.to_owned()));
        }
        Self::of_any_policy(policy, capacity_bytes, objects, seed)
    }

    fn of_any_policy(policy: Policy, capacity: u64, objects: u32, seed: u64) -> Result<Self, TraceError> {
        let cache: Box<dyn Cache + Send> = match policy {
            Policy::Lru => Box::new(Store::new(capacity, objects, Lru::new(objects))),
            Policy::Fifo => Box::new(Store::new(capacity, objects, Fifo::new(objects))),
            Policy::Clock => Box::new(Store::new(capacity, objects, Clock::new(objects, true))),
            Policy::Clock0 => Box::new(Store::new(capacity, objects, Clock::new(objects, false))),
            Policy::Random => Box::new(Store::new(capacity, objects, Random::new(objects, seed))),
            Policy::Sieve => Box::new(Store::new(capacity, objects, Sieve::new(objects))),
            Policy::S3Fifo => Box::new(S3Fifo::new(capacity, objects)),
            Policy::Optimal => Box::new(Store::new(capacity, objects, Optimal::new(objects))),
            Policy::Srrip | Policy::Plru => {
                return Err(TraceError(format!(
                    "{policy} is for lines of one size in sets, and objects have sizes of their own: expected lru, fifo, \
                     clock, clock:0, random, sieve, s3-fifo or optimal"
                )));
            }
        };
        Ok(Self { cache, objects, counters: ObjectCounters::default() })
    }

    /// Requests objects, one after the other.
    ///
    /// # Errors
    /// An object's number is not below that of all objects. The cache has seen the requests before it then.
    pub fn requests(&mut self, piece: &[Request]) -> Result<(), TraceError> {
        self.requests_used_next_at(piece, &[])
    }

    /// `next_uses` has a number for each request, or none where the policy does not need them.
    fn requests_used_next_at(&mut self, piece: &[Request], next_uses: &[u32]) -> Result<(), TraceError> {
        // The part before an object that cannot be, which is all of it as a rule.
        let known = piece.iter().take_while(|request| request.object < self.objects).count();
        self.cache.requests(&piece[..known], next_uses, &mut self.counters);
        piece.get(known).map_or(Ok(()), |request| Err(unknown(request.object, self.objects)))
    }

    /// What was counted so far.
    pub fn counters(&self) -> ObjectCounters {
        self.counters
    }
}

fn unknown(object: u32, objects: u32) -> TraceError {
    TraceError(format!("object {object}, expected one of {objects}, counted from 0"))
}

/// What a cache counts for all requests: [`ObjectCache`], and optimal replacement too, which evicts the object that is not used
/// for the longest time, as libCacheSim's Belady does. With different sizes that is no bound: it may be better to evict several
/// small objects that are used earlier, or a large one.
///
/// # Errors
/// The trace's, and those of [`ObjectCache`]. Optimal replacement takes at most 2³² − 2 requests.
pub fn count_misses(
    policy: Policy,
    capacity_bytes: u64,
    objects: u32,
    seed: u64,
    requests: &(impl Requests + ?Sized),
) -> Result<ObjectCounters, TraceError> {
    let mut cache = ObjectCache::of_any_policy(policy, capacity_bytes, objects, seed)?;
    if policy == Policy::Optimal {
        let next_uses = next_uses(requests, objects)?;
        let mut left = &next_uses[..];
        requests.for_each_piece(&mut |piece| {
            let Some((uses, later)) = left.split_at_checked(piece.len()) else {
                return Err(TraceError("there are more requests than a moment ago".to_owned()));
            };
            left = later;
            cache.requests_used_next_at(piece, uses)
        })?;
    } else {
        requests.for_each_piece(&mut |piece| cache.requests(piece))?;
    }
    Ok(cache.counters())
}
