//! Caches of objects against lists.

use proptest::prelude::*;

use super::*;

fn requests(pairs: &[(u32, u64)]) -> Vec<Request> {
    pairs.iter().map(|&(object, bytes)| Request { object, bytes }).collect()
}

fn counted(policy: Policy, capacity: u64, requests: &[Request]) -> ObjectCounters {
    count_misses(policy, capacity, 64, 7, requests).expect("objects below 64")
}

/// An object of a list.
#[derive(Clone, Copy)]
struct Entry {
    object: u32,
    bytes: u64,
    hits: u32,
}

impl Entry {
    fn new(request: Request) -> Self {
        Self { object: request.object, bytes: request.bytes, hits: 0 }
    }
}

fn sum(list: &[Entry]) -> u64 {
    list.iter().map(|entry| entry.bytes).sum()
}

/// Of one list, the oldest object first. `hit` and `victim` are the policy.
fn in_a_list(
    capacity: u64,
    requests: &[Request],
    hit: impl Fn(&mut Vec<Entry>, usize),
    mut victim: impl FnMut(&mut Vec<Entry>, usize) -> usize,
) -> ObjectCounters {
    let (mut list, mut counters) = (Vec::<Entry>::new(), ObjectCounters::default());
    for (at, &request) in requests.iter().enumerate() {
        let found = list.iter().position(|entry| entry.object == request.object);
        counters.count(request, found.is_some());
        if let Some(place) = found {
            list[place].hits += 1;
            hit(&mut list, place);
        } else if request.bytes <= capacity {
            while sum(&list) + request.bytes > capacity {
                let place = victim(&mut list, at);
                list.remove(place);
            }
            list.push(Entry::new(request));
        }
    }
    counters
}

fn stay(_list: &mut Vec<Entry>, _place: usize) {}

fn expected_lru(capacity: u64, requests: &[Request]) -> ObjectCounters {
    let to_the_end = |list: &mut Vec<Entry>, place: usize| {
        let entry = list.remove(place);
        list.push(entry);
    };
    in_a_list(capacity, requests, to_the_end, |_, _| 0)
}

fn expected_fifo(capacity: u64, requests: &[Request]) -> ObjectCounters {
    in_a_list(capacity, requests, stay, |_, _| 0)
}

fn expected_clock(capacity: u64, requests: &[Request], begins_referenced: bool) -> ObjectCounters {
    // A mark is lost once: the hits before that are forgotten.
    let mut passed = std::collections::HashMap::<(u32, usize), u32>::new();
    let mut placed = [0usize; 64];
    let marked = |entry: &Entry, passed: u32| entry.hits + u32::from(begins_referenced) > passed;
    in_a_list(capacity, requests, stay, move |list, _| {
        loop {
            let first = list[0];
            let key = (first.object, placed[first.object as usize]);
            let before = passed.get(&key).copied().unwrap_or(0);
            if !marked(&first, before) {
                placed[first.object as usize] += 1;
                return 0;
            }
            passed.insert(key, first.hits + u32::from(begins_referenced));
            list.rotate_left(1);
        }
    })
}

fn expected_sieve(capacity: u64, requests: &[Request]) -> ObjectCounters {
    let mut hand = 0;
    in_a_list(capacity, requests, stay, move |list, _| {
        while list[hand].hits > 0 {
            list[hand].hits = 0;
            hand = (hand + 1) % list.len();
        }
        let victim = hand;
        // What is placed behind the last object is not what the hand waits for.
        hand = if victim + 1 == list.len() { 0 } else { victim };
        victim
    })
}

/// The object whose next request is the last, of those which are never requested again the one that is placed first.
fn expected_optimal(capacity: u64, requests: &[Request]) -> ObjectCounters {
    in_a_list(capacity, requests, stay, |list, at| {
        let next = |object| requests[at..].iter().position(|request| request.object == object).unwrap_or(usize::MAX);
        let latest = list.iter().map(|entry| next(entry.object)).max().expect("not empty");
        list.iter().position(|entry| next(entry.object) == latest).expect("one of them")
    })
}

fn expected_s3_fifo(capacity: u64, requests: &[Request]) -> ObjectCounters {
    let (small_bytes, ghost_bytes) = (capacity / 10, capacity * 9 / 10);
    let (mut small, mut main, mut ghost) = (Vec::<Entry>::new(), Vec::<Entry>::new(), Vec::<Entry>::new());
    let (mut has_evicted, mut counters) = (false, ObjectCounters::default());
    for &request in requests {
        if let Some(entry) = small.iter_mut().chain(&mut main).find(|entry| entry.object == request.object) {
            entry.hits += 1;
            counters.count(request, true);
            continue;
        }
        counters.count(request, false);
        let remembered = ghost.iter().position(|entry| entry.object == request.object).map(|place| ghost.remove(place));
        if request.bytes > small_bytes {
            continue;
        }
        while sum(&small) + sum(&main) + request.bytes > capacity {
            has_evicted = true;
            if sum(&main) > capacity - small_bytes || small.is_empty() {
                let first = main.remove(0);
                if first.hits > 0 {
                    main.push(Entry { hits: first.hits.min(3) - 1, ..first });
                }
                continue;
            }
            let kept = small.iter().take_while(|entry| entry.hits >= 2).count();
            main.extend(small.drain(..kept).map(|entry| Entry { hits: 0, ..entry }));
            if !small.is_empty() {
                ghost.push(small.remove(0));
                while sum(&ghost) > ghost_bytes {
                    ghost.remove(0);
                }
            }
        }
        if remembered.is_some() {
            main.push(Entry::new(request));
        } else if request.bytes < small_bytes {
            let is_full = !has_evicted && sum(&small) >= small_bytes;
            if is_full { &mut main } else { &mut small }.push(Entry::new(request));
        }
    }
    counters
}

#[test]
fn by_hand() {
    // 10 bytes. 0 and 1 are 9 bytes together; 2 needs 4, so that 0 is evicted, and 1 stays. 3 is larger than the cache: nothing is
    // evicted for it. 1 is hit, and asks for 8 bytes, but has 4. 0 evicts 2 with LRU, and 1 with FIFO, which misses it next.
    let requests = requests(&[(0, 5), (1, 4), (2, 4), (3, 11), (1, 8), (0, 5), (1, 4), (2, 4)]);
    let all = ObjectCounters { requests: 8, misses: 0, bytes_requested: 45, bytes_missed: 0 };
    let lru = ObjectCounters { misses: 6, bytes_missed: 5 + 4 + 4 + 11 + 5 + 4, ..all };
    assert_eq!(counted(Policy::Lru, 10, &requests), lru);
    let fifo = ObjectCounters { misses: 7, bytes_missed: lru.bytes_missed + 4, ..all };
    assert_eq!(counted(Policy::Fifo, 10, &requests), fifo);
    let ratios = |counters: ObjectCounters| (counters.object_miss_ratio(), counters.byte_miss_ratio());
    assert_eq!(ratios(lru), (0.75, 33.0 / 45.0));
    assert_eq!(ratios(ObjectCounters::default()), (0.0, 0.0));
    // All fits.
    assert_eq!(counted(Policy::Lru, 24, &requests).misses, 4);
}

#[test]
fn what_cannot_be_is_refused() {
    let refused = |policy| ObjectCache::new(policy, 100, 4, 0).err().map(|error| error.to_string());
    for policy in [Policy::Srrip, Policy::Plru] {
        let expected = format!(
            "{policy} is for lines of one size in sets, and objects have sizes of their own: expected lru, fifo, clock, clock:0, \
             random, sieve, s3-fifo or optimal"
        );
        assert_eq!(refused(policy), Some(expected));
    }
    let expected = "optimal replacement needs all requests in advance: expected them to be counted as a whole";
    assert_eq!(refused(Policy::Optimal), Some(expected.to_owned()));
    let requests = requests(&[(1, 4), (4, 4)]);
    for policy in [Policy::Lru, Policy::S3Fifo, Policy::Optimal] {
        let error = count_misses(policy, 100, 4, 0, &requests[..]).expect_err("object 4");
        assert_eq!(error.to_string(), "object 4, expected one of 4, counted from 0");
    }
}

#[test]
fn the_largest_sizes_are_counted() {
    let requests = requests(&[(0, u64::MAX), (1, u64::MAX - 1), (1, 1), (0, u64::MAX)]);
    for policy in [Policy::Lru, Policy::Random, Policy::Clock] {
        let counters = counted(policy, u64::MAX, &requests);
        assert_eq!((counters.misses, counters.bytes_missed), (3, u64::MAX), "{policy}");
    }
    assert_eq!(counted(Policy::S3Fifo, u64::MAX, &requests).misses, 4);
}

/// Requests, not all of the same size.
fn some_requests() -> impl Strategy<Value = Vec<Request>> {
    let one = (0u32..24, 0u64..30, 1usize..4);
    prop::collection::vec(one, 0..300).prop_map(|requests| {
        let repeated = requests.into_iter().flat_map(|(object, bytes, times)| vec![Request { object, bytes }; times]);
        repeated.collect()
    })
}

proptest! {
    #[test]
    fn agree_with_lists(requests in some_requests(), capacity in 0u64..400) {
        prop_assert_eq!(counted(Policy::Lru, capacity, &requests), expected_lru(capacity, &requests));
        prop_assert_eq!(counted(Policy::Fifo, capacity, &requests), expected_fifo(capacity, &requests));
        prop_assert_eq!(counted(Policy::Clock, capacity, &requests), expected_clock(capacity, &requests, true));
        prop_assert_eq!(counted(Policy::Clock0, capacity, &requests), expected_clock(capacity, &requests, false));
        prop_assert_eq!(counted(Policy::Sieve, capacity, &requests), expected_sieve(capacity, &requests));
    }

    /// Objects without bytes are never alone in a queue, so that lists and sums say the same about it.
    #[test]
    fn s3_fifo_agrees_with_lists(mut requests in some_requests(), capacity in 0u64..800) {
        requests.iter_mut().for_each(|request| request.bytes += 1);
        prop_assert_eq!(counted(Policy::S3Fifo, capacity, &requests), expected_s3_fifo(capacity, &requests));
    }

    /// Where all objects have the same size, any of those that are never used again may be evicted.
    #[test]
    fn optimal_agrees_with_looking_ahead(mut requests in some_requests(), capacity in 3u64..60) {
        requests.iter_mut().for_each(|request| request.bytes = 3);
        let optimal = counted(Policy::Optimal, capacity, &requests);
        prop_assert_eq!(optimal, expected_optimal(capacity, &requests));
        for policy in [Policy::Lru, Policy::Fifo, Policy::Clock, Policy::Clock0, Policy::Random, Policy::Sieve, Policy::S3Fifo] {
            prop_assert!(optimal.misses <= counted(policy, capacity, &requests).misses, "{}", policy);
        }
    }

    #[test]
    fn pieces_and_sizes_change_nothing(requests in some_requests(), capacity in 0u64..400, part in 1usize..50) {
        struct Pieces<'a>(&'a [Request], usize);
        impl Requests for Pieces<'_> {
            fn for_each_piece(
                &self,
                consume: &mut dyn FnMut(&[Request]) -> Result<(), TraceError>,
            ) -> Result<(), TraceError> {
                self.0.chunks(self.1).try_for_each(consume)
            }
        }
        for policy in [Policy::Lru, Policy::Random, Policy::S3Fifo, Policy::Optimal] {
            let whole = counted(policy, capacity, &requests);
            prop_assert_eq!(count_misses(policy, capacity, 64, 7, &Pieces(&requests, part)), Ok(whole));
            prop_assert_eq!(whole.requests, requests.len() as u64);
            prop_assert_eq!(whole.bytes_requested, requests.iter().map(|request| request.bytes).sum::<u64>());
        }
    }
}
