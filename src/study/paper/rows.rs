//! The study as CSV: a row a figure.

use std::fmt::Write;

use super::Paper;
use crate::study::counts::Ratio;
use crate::study::published;
use crate::study::setting::Setting;
use crate::study::traffic::Traffic;
use crate::topology::{MemorySize, Octree};

const COLUMNS: &str =
    "part,scene,leaf_size,max_depth,line_bytes,replacement,nodes,local_memory,quantity,found,published\n";

/// Rows with a header. What has no meaning for a figure, and what the paper does not publish, is empty.
pub fn csv(paper: &Paper) -> String {
    let mut rows = Rows(COLUMNS.to_owned());
    for figure in &paper.figure1 {
        let mut row = |quantity: &str, found: f64, published: Option<f64>| {
            rows.row("figure 1", &figure.scene, figure.octree, ",,,", quantity, found, published);
        };
        for level in &figure.levels {
            row(&format!("nodes on level {}", level.level), level.nodes as f64, None);
            row(&format!("accesses to level {}", level.level), level.accesses as f64, None);
        }
        row("deepest nodes_share", figure.deepest.nodes_share, Some(figure.published.nodes_share));
        row("deepest accesses_share", figure.deepest.accesses_share, Some(figure.published.accesses_share));
        for (name, factor) in [("without_deepest", &figure.without_deepest), ("only_top", &figure.only_top)] {
            row(&format!("{name} primitive_tests"), factor.primitive_tests, None);
            row(&format!("{name} flops"), factor.flops, Some(figure.published_factor));
        }
    }
    for traffic in paper.traffic.iter().chain(&paper.replacements) {
        rows.traffic(traffic);
    }
    for table in &paper.table1 {
        for ((size, found), published) in published::TABLE_SIZES.iter().zip(table.found).zip(table.published) {
            let at = place(&table.setting, table.nodes, *size);
            let (scene, tree) = (&table.setting.scene, table.setting.octree);
            rows.row("table 1", scene, tree, &at, table.ratio.name(), found, Some(published));
        }
    }
    for found in &paper.processors {
        let at = place(&found.setting, found.nodes, published::share(32));
        let mut row = |quantity, value, published| {
            rows.row("processors", &found.setting.scene, found.setting.octree, &at, quantity, value, published);
        };
        row("by_accesses", found.by_accesses, Some(f64::from(found.published)));
        row("by_words", found.by_words, Some(f64::from(found.published)));
        row("presupposed_bus_bytes", found.presupposed_bus_bytes, None);
    }
    rows.0
}

/// The columns from `line_bytes` to `local_memory`.
fn place(setting: &Setting, nodes: u16, size: MemorySize) -> String {
    format!("{},{},{nodes},{size}", setting.line_bytes, setting.replacement)
}

struct Rows(String);

impl Rows {
    #[expect(clippy::too_many_arguments, reason = "a row's columns")]
    fn row(
        &mut self,
        part: &str,
        scene: &str,
        octree: Octree,
        place: &str,
        quantity: &str,
        found: f64,
        published: Option<f64>,
    ) {
        let Octree { leaf_size, max_depth, .. } = octree;
        let published = published.map_or_else(String::new, |published| published.to_string());
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, "{part},{scene},{leaf_size},{max_depth},{place},{quantity},{found},{published}");
    }

    fn traffic(&mut self, traffic: &Traffic) {
        let Setting { scene, octree, .. } = &traffic.setting;
        for size in &traffic.sizes {
            let at = place(&traffic.setting, traffic.nodes, size.local_memory);
            let mut row =
                |quantity, found: f64, published| self.row("traffic", scene, *octree, &at, quantity, found, published);
            row("local_bytes", size.local_bytes as f64, None);
            row("record_accesses", size.counts.record_accesses as f64, None);
            row("misses", size.counts.misses as f64, None);
            row("words_read", size.counts.words_read as f64, None);
            row("words_moved", size.counts.words_moved as f64, None);
            row("bus_bytes", size.bus_bytes as f64, None);
            row("bus share", traffic.bus_shares(size)[0], None);
            row(Ratio::MissesPerRecordAccess.name(), size.ratio(Ratio::MissesPerRecordAccess), None);
        }
        let at = format!("{},{},{},", traffic.setting.line_bytes, traffic.setting.replacement, traffic.nodes);
        let about = published::MESSAGE_BYTES_ABOUT as f64;
        let messages = traffic.messages.bytes() as f64;
        self.row("traffic", scene, *octree, &at, "message_bytes", messages, Some(about));
    }
}
