//! Local memories that hold whole objects of different sizes, least recently used: a model, which no live run has.

use crate::study::runs::traced::Traced;
use machine::hardware::references::{RecordNumbers, ReferenceWord};
use machine::replay::model::objects::{ObjectCache, Request};
use machine::replay::plan::schedule::TileSchedule;
use machine::replay::plan::setting::Policy;
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

    /// For the object that a record is of; `None` for records that are not counted.
    fn request(&self, record: u32) -> Option<Request> {
        match self.numbers.place(record) {
            (Section::OctreeNodes, index) => {
                Some(Request { object: index / self.siblings, bytes: self.node_bytes().into() })
            }
            (section, index) if section == self.section => {
                Some(Request { object: self.blocks + index, bytes: self.object_bytes.into() })
            }
            _ => None,
        }
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
        let objects = self.blocks + self.others;
        let of_node = |processes: &Vec<Vec<u32>>| {
            let mut sums = [Accesses::default(); 4];
            let (mut words, mut requests) = (Vec::new(), Vec::new());
            for tiles in processes {
                let mut memories = Vec::new();
                for capacity in capacities {
                    memories.push(ObjectCache::new(Policy::Lru, capacity, objects, 0)?);
                }
                for part in tiles.iter().flat_map(|&tile| traced.tiles()[tile as usize].parts.clone()) {
                    traced.read(part, &mut words)?;
                    let reads = words.iter().filter(|&&word| ReferenceWord(word).is_read());
                    requests.clear();
                    requests.extend(reads.filter_map(|&record| self.request(record)));
                    memories.iter_mut().try_for_each(|memory| memory.requests(&requests))?;
                }
                for (sum, memory) in sums.iter_mut().zip(memories) {
                    sum.all += memory.counters().requests;
                    sum.misses += memory.counters().misses;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn octree_nodes_are_copied_with_their_siblings_and_other_records_are_not_counted() {
        // Two blocks of octree words, one leaf list entry, three triangles.
        let layout = Layout::new([16, 1, 3, 0, 0, 0, 0, 0, 0]).expect("small");
        let objects = WholeObjects::new(&layout, 300, 8);
        assert_eq!(objects.bytes(), 2 * 32 + 3 * 300);
        let request = |object, bytes| Some(Request { object, bytes });
        let of = |record| objects.request(record);
        assert_eq!([of(0), of(7), of(8), of(15)], [request(0, 32), request(0, 32), request(1, 32), request(1, 32)]);
        assert_eq!([of(16), of(17), of(19)], [None, request(2, 300), request(4, 300)]);
    }
}
