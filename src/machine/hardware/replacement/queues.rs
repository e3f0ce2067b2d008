//! Doubly linked queues over numbered elements, for policies that keep an order.

/// No element.
const NONE: u32 = u32::MAX;

/// Queues of elements that are numbered from 0. An element is in one queue at most.
#[derive(Clone, Debug, Default)]
pub(crate) struct Queues {
    /// By element.
    links: Vec<Ends>,
    /// By queue.
    ends: Vec<Ends>,
}

/// Of an element: what came after it and before it. Of a queue: its last and its first element.
#[derive(Clone, Copy, Debug)]
struct Ends {
    newer: u32,
    older: u32,
}

const NO_ENDS: Ends = Ends { newer: NONE, older: NONE };

impl Queues {
    /// So many empty queues for so many elements, fewer than 2³² − 1.
    pub(crate) fn new(queues: u32, elements: u32) -> Self {
        Self { links: vec![NO_ENDS; elements as usize], ends: vec![NO_ENDS; queues as usize] }
    }

    /// The element that is in the queue for the longest time.
    #[inline]
    pub(crate) fn oldest(&self, queue: u32) -> Option<u32> {
        some(self.ends[queue as usize].older)
    }

    /// The element that came into its queue after this one.
    #[inline]
    pub(crate) fn newer(&self, element: u32) -> Option<u32> {
        some(self.links[element as usize].newer)
    }

    /// Adds an element that is in no queue, as the newest one.
    pub(crate) fn push(&mut self, queue: u32, element: u32) {
        let ends = &mut self.ends[queue as usize];
        let before = std::mem::replace(&mut ends.newer, element);
        if before == NONE {
            ends.older = element;
        } else {
            self.links[before as usize].newer = element;
        }
        self.links[element as usize] = Ends { newer: NONE, older: before };
    }

    /// Takes an element out of the queue that it is in.
    pub(crate) fn remove(&mut self, queue: u32, element: u32) {
        let Ends { newer, older } = std::mem::replace(&mut self.links[element as usize], NO_ENDS);
        match some(newer) {
            Some(newer) => self.links[newer as usize].older = older,
            None => self.ends[queue as usize].newer = older,
        }
        match some(older) {
            Some(older) => self.links[older as usize].newer = newer,
            None => self.ends[queue as usize].older = newer,
        }
    }

    /// Takes the oldest element out of a queue.
    pub(crate) fn pop(&mut self, queue: u32) -> Option<u32> {
        let element = self.oldest(queue)?;
        self.remove(queue, element);
        Some(element)
    }
}

#[inline]
fn some(element: u32) -> Option<u32> {
    (element != NONE).then_some(element)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn agree_with_lists(operations in prop::collection::vec((0u32..2, 0u32..8, any::<bool>()), 0..80)) {
            let mut queues = Queues::new(2, 8);
            let mut lists = [Vec::new(), Vec::new()];
            for (queue, element, pop) in operations {
                if pop {
                    let list = &mut lists[queue as usize];
                    let first = (!list.is_empty()).then(|| list.remove(0));
                    prop_assert_eq!(queues.pop(queue), first);
                } else if let Some(of) = (0..2).find(|of| lists[*of as usize].contains(&element)) {
                    lists[of as usize].retain(|other| *other != element);
                    queues.remove(of, element);
                } else {
                    lists[queue as usize].push(element);
                    queues.push(queue, element);
                }
                for (queue, list) in (0..).zip(&lists) {
                    let all: Vec<_> = std::iter::successors(queues.oldest(queue), |&element| queues.newer(element)).collect();
                    prop_assert_eq!(&all, list);
                }
            }
        }
    }
}
