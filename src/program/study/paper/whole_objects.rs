//! Local memories that hold whole objects of different sizes, least recently used: a model, which no live run has.

use crate::study::runs::traced::Traced;
use machine::hardware::references::{RecordNumbers, ReferenceWord};
use machine::replay::plan::schedule::TileSchedule;
use machine::replay::{Trace, TraceError, parallel};
use trace::database::{Layout, Section};

/// Bytes of an octree node.
const NODE_BYTES: u32 = 4;

/// Which records are objects, and how large these are.
#[derive(Clone, Copy, Debug)]
pub(super) struct WholeObjects {
    numbers: RecordNumbers,
    /// Octree nodes that are one object, a power of two.
    siblings: u32,
    /// Objects that are octree nodes.
    blocks: u32,
    /// The section of the others: polygons, or triangles where there are none.
    section: Section,
    others: u32,
    object_bytes: u32,
}

/// Accesses of all nodes, and how many of them missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Accesses {
    pub(super) all: u64,
    pub(super) misses: u64,
}

impl WholeObjects {
    pub(super) fn new(layout: &Layout, object_bytes: u32, siblings: u32) -> Self {
        let section = if layout.has_polygons() { Section::Polygons } else { Section::Triangles };
        // An image has at most 2³⁰ records.
        let records = |section| layout.span(section).records as u32;
        let blocks = records(Section::OctreeNodes).div_ceil(siblings);
        let numbers = RecordNumbers::new(layout);
        Self { numbers, siblings, blocks, section, others: records(section), object_bytes }
    }

    /// Bytes of all objects.
    pub(super) fn bytes(&self) -> u64 {
        u64::from(self.blocks) * u64::from(self.node_bytes()) + u64::from(self.others) * u64::from(self.object_bytes)
    }

    fn node_bytes(&self) -> u32 {
        self.siblings * NODE_BYTES
    }

    /// The object that a record is of; `None` for records that are not counted.
    fn object(&self, record: u32) -> Option<u32> {
        match self.numbers.place(record) {
            (Section::OctreeNodes, index) => Some(index / self.siblings),
            (section, index) if section == self.section => Some(self.blocks + index),
            _ => None,
        }
    }

    fn bytes_of(&self, object: u32) -> u32 {
        if object < self.blocks { self.node_bytes() } else { self.object_bytes }
    }

    /// What memories of these capacities count, in bytes: one of each per node.
    ///
    /// # Errors
    /// The trace cannot be read.
    pub(super) fn count<T: Trace>(
        &self,
        traced: &Traced<T>,
        schedule: &TileSchedule,
        capacities: [u64; 4],
    ) -> Result<[Accesses; 4], TraceError> {
        let of_node = |processes: &Vec<Vec<u32>>| {
            let mut sums = [Accesses::default(); 4];
            for tiles in processes {
                let mut memories = capacities.map(|capacity| LruBytes::new(self.blocks + self.others, capacity));
                let mut words = Vec::new();
                for &tile in tiles {
                    for part in traced.tiles()[tile as usize].parts.clone() {
                        traced.read(part, &mut words)?;
                        let reads = words.iter().filter(|&&word| ReferenceWord(word).is_read());
                        for object in reads.filter_map(|&record| self.object(record)) {
                            for (memory, sum) in memories.iter_mut().zip(&mut sums) {
                                sum.all += 1;
                                sum.misses += u64::from(memory.misses(object, |object| self.bytes_of(object)));
                            }
                        }
                    }
                }
            }
            Ok::<_, TraceError>(sums)
        };
        let mut sums = [Accesses::default(); 4];
        for node in parallel::map(&schedule.nodes, of_node) {
            for (sum, node) in sums.iter_mut().zip(node?) {
                sum.all += node.all;
                sum.misses += node.misses;
            }
        }
        Ok(sums)
    }
}

/// Objects in the order of their latest use, as many as there is room for.
struct LruBytes {
    capacity: u64,
    room: u64,
    /// By object, and last the end of the list: its neighbours, towards the most and the least recently used. An object that is
    /// absent is its own neighbour.
    newer: Vec<u32>,
    older: Vec<u32>,
}

impl LruBytes {
    fn new(objects: u32, capacity: u64) -> Self {
        let alone: Vec<u32> = (0..=objects).collect();
        Self { capacity, room: capacity, newer: alone.clone(), older: alone }
    }

    /// References an object: whether it was absent.
    fn misses(&mut self, object: u32, bytes_of: impl Fn(u32) -> u32) -> bool {
        let end = self.newer.len() as u32 - 1;
        let is_absent = self.newer[object as usize] == object;
        if is_absent {
            let bytes = u64::from(bytes_of(object));
            if bytes > self.capacity {
                return true;
            }
            while self.room < bytes {
                let oldest = self.newer[end as usize];
                self.take_out(oldest);
                self.room += u64::from(bytes_of(oldest));
            }
            self.room -= bytes;
        } else {
            self.take_out(object);
        }
        let newest = self.older[end as usize];
        (self.newer[newest as usize], self.older[object as usize]) = (object, newest);
        (self.newer[object as usize], self.older[end as usize]) = (end, object);
        is_absent
    }

    fn take_out(&mut self, object: u32) {
        let (newer, older) = (self.newer[object as usize], self.older[object as usize]);
        (self.older[newer as usize], self.newer[older as usize]) = (older, newer);
        (self.newer[object as usize], self.older[object as usize]) = (object, object);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_objects_make_room() {
        // Objects 0 to 2 have one byte, 3 and 4 have three.
        let bytes = |object: u32| if object < 3 { 1 } else { 3 };
        let mut memory = LruBytes::new(5, 4);
        let misses: Vec<bool> = [0, 1, 2, 0, 3, 0, 1, 3, 4, 4].map(|object| memory.misses(object, bytes)).to_vec();
        // 3 needs three bytes: 1 and 2 go, 0 stays. Then 1 needs one: 3 goes, used longest ago. 3 comes back for 0 (and not for 1: three
        // bytes are free after it). 4 then needs all of it but one byte: 1 stays.
        assert_eq!(misses, [true, true, true, false, true, false, true, true, true, false]);
    }

    #[test]
    fn agrees_with_a_list() {
        let bytes = |object: u32| 1 + object * 7 % 13;
        for capacity in [0, 5, 12, 40, 100, 1000] {
            let (mut memory, mut list) = (LruBytes::new(40, capacity), Vec::<u32>::new());
            for object in (0..4000u32).map(|i| (i.wrapping_mul(0x9E37_79B1) >> 16) % 40 * (i % 3) / 2) {
                let known = list.iter().position(|&other| other == object);
                if let Some(place) = known {
                    list.remove(place);
                }
                if u64::from(bytes(object)) <= capacity {
                    list.push(object);
                    while list.iter().map(|&object| u64::from(bytes(object))).sum::<u64>() > capacity {
                        list.remove(0);
                    }
                }
                assert_eq!(memory.misses(object, bytes), known.is_none(), "{capacity}");
            }
        }
    }
}
