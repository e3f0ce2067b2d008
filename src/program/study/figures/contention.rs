//! What nodes that share a bus cost one another, simulated beside what queueing theory expects.

use serde::Serialize;

use crate::study::figures::conditions::Conditions;
use crate::study::published;
use crate::study::runs::traced::Traced;
use machine::hardware::specification::{Bus, MemorySize, Processor};
use machine::replay::contention::table::{ContentionTable, contention_table};
use machine::replay::plan::setting::{Assignment, Policy, Setting};
use machine::replay::{Trace, TraceError};
use machine::tile_order::TileOrder;

/// The smallest memory of Table 1.
pub const SMALLEST: MemorySize = published::share(32);

/// One cluster with more and more nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Contention {
    #[serde(flatten)]
    pub conditions: Conditions,
    #[serde(serialize_with = "crate::study::figures::traffic::as_text")]
    pub local_memory: MemorySize,
    pub assignment: Assignment,
    pub processor: Processor,
    pub bus: Bus,
    #[serde(flatten)]
    pub table: ContentionTable,
}

impl Contention {
    /// Tiles row by row from the top, to the node that asks for one; fully associative LRU memories of `size`; the
    /// topology's costs, but for the bus width.
    ///
    /// # Errors
    /// The trace cannot be read, or the memory is too small.
    pub fn new<T: Trace>(
        traced: &Traced<T>,
        size: MemorySize,
        line: u32,
        bus_width: u32,
        nodes: &[u16],
    ) -> Result<Self, TraceError> {
        let setting = Setting {
            local_memory: size,
            line,
            ways: None,
            replacement: Policy::Lru,
            nodes: 1,
            clusters: 1,
            tile_order: TileOrder::Scanline,
            assignment: Assignment::OnDemand,
            bus: Bus { width: bus_width, ..traced.run.bus },
            processor: traced.run.processor,
        };
        let settings: Vec<_> = nodes.iter().map(|&nodes| Setting { nodes, ..setting }).collect();
        Ok(Self {
            conditions: Conditions::new(traced, line, setting.tile_order),
            local_memory: size,
            assignment: setting.assignment,
            processor: setting.processor,
            bus: setting.bus,
            table: contention_table(traced, &settings, |_| {})?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::runs::fixture;

    #[test]
    fn more_nodes_are_faster_and_less_efficient_and_a_wider_bus_carries_more() {
        let (_, traced) = fixture::gears();
        let of = |width| Contention::new(&traced, published::share(8), 64, width, &[2, 4]).expect("in memory").table;
        let (narrow, wide) = (of(4), of(32));
        let [two, four] = narrow.rows[..] else { panic!("two rows") };
        assert!(1.0 < two.speed_up && two.speed_up < four.speed_up && four.speed_up <= 4.0);
        assert!(two.bus_utilisation < four.bus_utilisation && four.efficiency < two.efficiency);
        assert!((four.fixed_utilisation / four.bus_utilisation - 1.0).abs() < 0.25, "{four:?}");
        assert!(four.knee < wide.rows[1].knee && four.efficiency < wide.rows[1].efficiency);
    }
}
