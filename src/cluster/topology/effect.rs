//! Keys that a live run does not heed.

use super::{Topology, file};
use machine::hardware::specification::{Bus, MemorySize, Processor};
use trace::tracer::octree::Octree;

impl Topology {
    /// Keys that differ from their defaults and change nothing of a live run: those of the model that replays and studies
    /// compute times with, and with local memory "all" those of a memory that holds less.
    pub fn without_effect_live(&self) -> Vec<&'static str> {
        let (bus, processor) = (&self.cluster.bus, &self.cluster.processor);
        let memory = &self.cluster.local_memory;
        let holds_all = memory.size == MemorySize::All;
        let default = file::LocalMemory::default();
        let keys = [
            ("cluster.processor.octree_node", processor.octree_node != Processor::DEFAULT.octree_node),
            ("cluster.processor.primitive_test", processor.primitive_test != Processor::DEFAULT.primitive_test),
            ("cluster.processor.shading", processor.shading != Processor::DEFAULT.shading),
            ("cluster.processor.local_access", processor.local_access != Processor::DEFAULT.local_access),
            ("cluster.bus.width", bus.width != Bus::DEFAULT.width),
            ("cluster.bus.cycles_per_word", bus.cycles_per_word != Bus::DEFAULT.cycles_per_word),
            ("cluster.bus.latency", bus.latency != Bus::DEFAULT.latency),
            ("cluster.bus.transactions", bus.transactions != Bus::DEFAULT.transactions),
            ("cluster.local_memory.line", holds_all && memory.line != default.line.0),
            ("cluster.local_memory.ways", holds_all && memory.ways.is_some()),
            ("cluster.local_memory.replacement", holds_all && memory.replacement != default.replacement),
            ("octree.mailbox", holds_all && self.octree.mailbox != Octree::DEFAULT.mailbox),
        ];
        keys.into_iter().filter(|(_, is_idle)| *is_idle).map(|(key, _)| key).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trace::scene::source::Source;

    fn without_effect(text: &str) -> Vec<&'static str> {
        let source = "[scene]\nprocedural = \"teapot\"\n".to_owned() + text;
        let source = Source::from_bytes("x.toml", source);
        Topology::from_source(&source, &[]).expect("a topology").without_effect_live()
    }

    #[test]
    fn keys_of_the_model_have_no_effect_on_a_live_run() {
        assert!(without_effect("[cluster.bus]\narbiter = \"round_robin\"\nquantum = 4\nwidth = 4\n").is_empty());
        assert_eq!(
            without_effect("[cluster.bus]\nwidth = 8\ntransactions = \"split\"\n[cluster.processor]\nshading = 1\n"),
            ["cluster.processor.shading", "cluster.bus.width", "cluster.bus.transactions"]
        );
    }

    #[test]
    fn keys_of_a_smaller_memory_have_no_effect_where_a_node_has_the_whole_database() {
        let keys = "line = 128\nways = 2\nreplacement = \"fifo\"\n[octree]\nmailbox = false\n";
        assert!(without_effect(&format!("[cluster.local_memory]\n{keys}")).is_empty());
        assert_eq!(
            without_effect(&format!("[cluster.local_memory]\nsize = \"all\"\n{keys}")),
            [
                "cluster.local_memory.line",
                "cluster.local_memory.ways",
                "cluster.local_memory.replacement",
                "octree.mailbox"
            ]
        );
    }
}
