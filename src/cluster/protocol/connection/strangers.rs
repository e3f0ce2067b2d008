//! Who has been accepted and has not said who he is: how many there may be, and who makes room.

use std::collections::{HashMap, VecDeque};
use std::net::IpAddr;

/// Never more than so many. When one too many comes, the oldest goes of the address that has the most: whoever fills
/// the port keeps himself out first.
#[derive(Debug)]
pub(super) struct Strangers<H> {
    max: usize,
    /// Oldest first.
    waiting: VecDeque<(u64, IpAddr, H)>,
    entered: u64,
}

impl<H> Strangers<H> {
    pub(super) fn new(max: usize) -> Self {
        Self { max, waiting: VecDeque::new(), entered: 0 }
    }

    /// The number of the next one to enter.
    pub(super) fn next(&self) -> u64 {
        self.entered
    }

    /// Takes in one more, by its number; gives back the one who must leave for it.
    pub(super) fn enter(&mut self, from: IpAddr, handle: H) -> Option<H> {
        self.waiting.push_back((self.entered, from, handle));
        self.entered += 1;
        if self.waiting.len() <= self.max {
            return None;
        }
        let mut counts = HashMap::new();
        for (_, from, _) in &self.waiting {
            *counts.entry(*from).or_insert(0) += 1;
        }
        let most = counts.values().copied().max();
        let crowd = self.waiting.iter().position(|(_, from, _)| counts.get(from).copied() == most)?;
        self.waiting.remove(crowd).map(|(.., handle)| handle)
    }

    /// It has said who it is, or is gone.
    pub(super) fn leave(&mut self, number: u64) {
        if let Ok(at) = self.waiting.binary_search_by_key(&number, |(number, ..)| *number) {
            self.waiting.remove(at);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn address(last: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, last).into()
    }

    #[test]
    fn a_crowd_makes_room_by_itself() {
        let mut strangers = Strangers::new(4);
        for (from, handle) in [(1, 'a'), (2, 'b'), (2, 'c'), (3, 'd')] {
            assert_eq!(strangers.enter(address(from), handle), None);
        }
        assert_eq!(strangers.enter(address(2), 'e'), Some('b'));
        assert_eq!(strangers.enter(address(4), 'f'), Some('c'));
        assert_eq!(strangers.enter(address(1), 'g'), Some('a'));
    }

    #[test]
    fn who_leaves_leaves_room() {
        let mut strangers = Strangers::new(2);
        for handle in 0..100u64 {
            assert_eq!(strangers.next(), handle);
            assert_eq!(strangers.enter(address(handle as u8), handle), None);
            strangers.leave(handle);
            strangers.leave(handle);
        }
        assert!(strangers.waiting.is_empty());
    }
}
