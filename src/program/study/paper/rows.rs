//! The study as CSV: a row a figure.

use std::fmt::Write;

use super::{Claims, Found, LINE, OCTREE, Paper};
use crate::study::figures::conditions::Conditions;
use crate::study::figures::contention::{Contention, SMALLEST};
use crate::study::figures::ratio::Ratio;
use crate::study::figures::traffic::Traffic;
use crate::study::published;
use machine::hardware::specification::MemorySize;
use trace::tracer::octree::Octree;

const COLUMNS: &str = "part,scene,leaf_size,max_depth,line_bytes,nodes,local_memory,quantity,found,published\n";

/// Rows with a header. What has no meaning for a figure, and what the paper does not publish, is empty.
pub fn csv(paper: &Paper) -> String {
    let mut rows = Rows(COLUMNS.to_owned());
    for figure in &paper.figure1 {
        let mut row = |quantity: &str, found: f64, published: Option<f64>| {
            rows.row("figure 1", &figure.scene, figure.octree, ",,", quantity, found, published);
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
    for traffic in &paper.traffic {
        rows.traffic(traffic);
    }
    for found in &paper.settings {
        rows.table1(found);
    }
    for claims in &paper.claims {
        rows.claims(claims);
    }
    for replaced in &paper.replacements {
        for row in &replaced.rows {
            let at = format!("{},{},{}", row.setting.line, row.setting.nodes, row.setting.local_memory);
            let quantity =
                format!("{} {}", Ratio::MissesPerRecordAccess.name(), row.setting.replacement).to_lowercase();
            rows.row(
                "replacement",
                &replaced.scene,
                replaced.octree,
                &at,
                &quantity,
                row.misses_per_record_access,
                None,
            );
        }
    }
    for contention in paper.contention.iter().chain(&paper.widths) {
        rows.contention(contention);
    }
    rows.0
}

/// The columns from `line_bytes` to `local_memory`.
fn place(conditions: &Conditions, nodes: u16, size: MemorySize) -> String {
    format!("{},{nodes},{size}", conditions.line_bytes)
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

    /// The quantity names the definition; what else the setting is, the part does.
    fn table1(&mut self, found: &Found) {
        let setting = &found.setting;
        let part = format!("table 1: {setting}").replace(',', ";");
        let nodes = published::TABLE_NODES;
        for (scene, cells) in found.scenes.iter().zip(&found.cells) {
            for ((size, value), published) in published::TABLE_SIZES.iter().zip(cells.found).zip(cells.published) {
                let at = format!(",{nodes},{size}");
                self.row(&part, scene, setting.octree, &at, setting.unit.definition(), value, Some(published));
            }
        }
        let at = format!(",{nodes},");
        self.row(&part, "both", setting.octree, &at, "rmse", found.rmse, None);
        self.row(&part, "both", setting.octree, &at, "worst", found.worst, None);
    }

    fn claims(&mut self, claims: &Claims) {
        for balance in &claims.by_nodes {
            let at = format!("{LINE},{},{SMALLEST}", balance.nodes);
            let mut row = |quantity, found| self.row("claims", &claims.scene, OCTREE, &at, quantity, found, None);
            row("busy", balance.busy);
            row("busiest_over_mean", balance.busiest_over_mean);
            row("jobs", balance.jobs);
            row("pixels", balance.pixels);
            row("fetches", balance.fetches);
            row("build", balance.build);
        }
        let mut row = |quantity, found| self.row("claims", &claims.scene, OCTREE, ",,", quantity, found, None);
        row("nodes_read_per_ray", claims.nodes_read_per_ray);
        row("ascents_per_ray", claims.ascents_per_ray);
    }

    fn traffic(&mut self, traffic: &Traffic) {
        let Conditions { scene, octree, .. } = &traffic.conditions;
        for size in &traffic.sizes {
            let at = place(&traffic.conditions, traffic.nodes, size.local_memory);
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
        let at = format!("{},{},", traffic.conditions.line_bytes, traffic.nodes);
        let about = published::MESSAGE_BYTES_ABOUT as f64;
        let messages = traffic.messages.bytes() as f64;
        self.row("traffic", scene, *octree, &at, "message_bytes", messages, Some(about));
    }

    fn contention(&mut self, contention: &Contention) {
        let Conditions { scene, octree, .. } = &contention.conditions;
        let part = format!("contention on a bus of {} bytes", contention.bus.width);
        for found in &contention.table.rows {
            let at = place(&contention.conditions, found.setting.nodes, contention.local_memory);
            let mut row = |quantity, value| self.row(&part, scene, *octree, &at, quantity, value, None);
            row("cycles", found.cycles as f64);
            row("speed_up", found.speed_up);
            row("efficiency", found.efficiency);
            row("fixed_efficiency", found.fixed_efficiency);
            row("exponential_efficiency", found.exponential_efficiency);
            row("bus_utilisation", found.bus_utilisation);
            row("fixed_utilisation", found.fixed_utilisation);
            row("exponential_utilisation", found.exponential_utilisation);
            row("wait_mean", found.wait_mean);
            row("fixed_wait", found.fixed_wait);
            row("exponential_wait", found.exponential_wait);
            row("wait_percentile_99", found.wait_percentile_99 as f64);
            row("knee", found.knee);
        }
    }
}
