//! The study as text.

use std::fmt::Write;

use super::{Figure1, Found, GEARS, LINE, Paper, PaperScene, Search, TEAPOT, Unit, verdicts};
use crate::study::figures::conditions::octree;
use crate::study::figures::contention::{Contention, SMALLEST};
use crate::study::figures::levels::{FLOPS_PER_TEST, FLOPS_PER_VISIT};
use crate::study::figures::traffic::Traffic;
use crate::study::page::table::{Table, grouped, percent};
use crate::study::published;
use machine::hardware::specification::{Arbiter, Transactions};
use trace::picture::Sides;

/// Tables, each below what it shows and with which settings.
pub fn text(paper: &Paper) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write(&mut text, paper);
    text
}

fn write(out: &mut String, paper: &Paper) -> std::fmt::Result {
    let Sides { width, height, tile_width, tile_height } = paper.tiling.sides();
    writeln!(
        out,
        "The 1991 paper's figures beside this program's. {width}x{height} pixels in {} tiles of {tile_width}x{tile_height}, no antialiasing,\n\
         reflections and refractions to depth {}. Local memories are fully associative and LRU, tiles are handed out row by\n\
         row. What the paper leaves open is tried in several ways.\n",
        paper.tiling.tile_count(),
        paper.depth
    )?;
    agreements(out, paper)?;
    table1(out, paper)?;
    figure1(out, &paper.figure1)?;
    for scene in [&GEARS, &TEAPOT] {
        traffic(out, scene, paper)?;
    }
    replacements(out, paper)?;
    claims(out, paper)?;
    contentions(out, &paper.contention)?;
    widths(out, paper)
}

/// The factor by which a figure is off, and whether that is taken for agreement.
fn off(found: f64, published: f64) -> [String; 2] {
    let factor = verdicts::factor(found, published);
    [format!("{factor:.2}x"), if factor <= verdicts::FACTOR_MAX { "agrees" } else { "does not" }.to_owned()]
}

/// Each published number beside the settings that come nearest to Table 1.
fn agreements(out: &mut String, paper: &Paper) -> std::fmt::Result {
    let shown = best(paper);
    writeln!(out, "WHAT AGREES WITH WHAT  Within a factor of 1.25, under the settings that come nearest to Table 1\n")?;
    for (letter, found) in letters(paper).filter(|(_, found)| shown.contains(found)) {
        writeln!(out, "{letter}  {}; {}", found.setting, found.setting.unit.definition())?;
    }
    let mut table = Table::new(["", "published", "setting", "found", "off by", ""]);
    for (letter, found) in letters(paper).filter(|(_, found)| shown.contains(found)) {
        let setting = &found.setting;
        let mut row = |name: &str, published: String, found: String, off: [String; 2]| {
            let [off, verdict] = off;
            table.row(vec![name.to_owned(), published, letter.to_string(), found, off, verdict]);
        };
        let worst = [format!("{:.2}x", found.worst), String::new()];
        row("Table 1: RMSE, worst of eight cells", String::new(), format!("{:.3}", found.rmse), worst);
        let (bytes, about) = (found.cells[1].least_local_bytes, published::LOCAL_BYTES_ABOUT);
        row("1/32 of the teapot, bytes", grouped(about), grouped(bytes), off(bytes as f64, about as f64));
        let processors = found.processors();
        let processors_off = off(processors, f64::from(published::PROCESSORS));
        row("processors, 1/p", published::PROCESSORS.to_string(), format!("{processors:.1}"), processors_off);
        let scene = TEAPOT.on(setting.board).to_string();
        for figure in paper.figure1.iter().filter(|figure| figure.scene == scene && figure.octree == setting.octree) {
            let (deepest, published) = (figure.deepest, figure.published);
            for (name, found, published) in [
                ("Figure 1: nodes on four levels", deepest.nodes_share, published.nodes_share),
                ("Figure 1: accesses to them", deepest.accesses_share, published.accesses_share),
            ] {
                row(name, percent(published, 1), percent(found, 2), off(found, published));
            }
        }
    }
    writeln!(
        out,
        "\n{table}\nNo setting agrees with all of it. Figure 1 agrees with the teapot on its board, and another octree (below).\n"
    )
}

/// The settings, each with a letter.
fn letters(paper: &Paper) -> impl Iterator<Item = (char, &Found)> {
    ('A'..).zip(&paper.settings)
}

/// The nearest to Table 1 of each kind of unit and board.
fn best(paper: &Paper) -> Vec<&Found> {
    let mut all: Vec<&Found> = paper.settings.iter().collect();
    all.sort_by(|a, b| a.rmse.total_cmp(&b.rmse));
    let kind = |found: &Found| (found.setting.board, matches!(found.setting.unit, Unit::Whole { .. }));
    let mut kinds = Vec::new();
    all.retain(|found| {
        let is_new = !kinds.contains(&kind(found));
        kinds.push(kind(found));
        is_new
    });
    all
}

fn table1(out: &mut String, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "TABLE 1  Shared memory accesses / local memory accesses, {} nodes, one setting for both scenes. RMSE: root of the\n\
         mean square of ln(found / published) over the eight cells. `marti study paper --search` tries {} settings.\n",
        published::TABLE_NODES,
        grouped(paper.settings_searched as u64)
    )?;
    let rows: Vec<_> = letters(paper).map(|(letter, found)| (letter.to_string(), found)).collect();
    writeln!(out, "{}", settings(&rows))
}

/// What a search found, best first.
pub fn search(search: &Search) -> String {
    let rows: Vec<_> = (1..).zip(&search.settings).map(|(number, found)| (number.to_string(), found)).collect();
    format!(
        "{} settings, each the same for both scenes; the best by board and kind of record\n\n{}",
        grouped(search.tried as u64),
        settings(&rows)
    )
}

/// What each setting is, and its cells.
fn settings(all: &[(String, &Found)]) -> String {
    let mut out = String::new();
    for (name, found) in all {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{name}  {}; {}", found.setting, found.setting.unit.definition());
    }
    let sizes = published::TABLE_SIZES.map(|size| size.to_string());
    let [a, b, c, d] = sizes.each_ref().map(String::as_str);
    let mut table = Table::new(["setting", "gears", a, b, c, d, "teapot", a, b, c, d, "RMSE", "worst"]);
    let cells = |values: [f64; 4]| values.map(|value| format!("{value:.4}"));
    let row = |name: &str, gears: [f64; 4], teapot: [f64; 4], tail: [String; 2]| {
        let gears = [name.to_owned(), String::new()].into_iter().chain(cells(gears));
        gears.chain([String::new()]).chain(cells(teapot)).chain(tail).collect()
    };
    let tail = [String::new(), String::new()];
    table.row(row("published", published::TABLE_GEARS, published::TABLE_TEAPOT, tail));
    for (name, found) in all {
        let tail = [format!("{:.3}", found.rmse), format!("{:.2}x", found.worst)];
        table.row(row(name, found.cells[0].found, found.cells[1].found, tail));
    }
    let _ = write!(out, "\n{table}");
    out
}

fn figure1(out: &mut String, figures: &[Figure1]) -> std::fmt::Result {
    writeln!(
        out,
        "FIGURE 1  The teapot's octree. Floating point operations are counted as {FLOPS_PER_VISIT} per octree node visited and {FLOPS_PER_TEST} per\n\
         primitive test. \"The cost increases fourteenfold\" where the four deepest levels are not built.\n"
    )?;
    let mut table = Table::new([
        "scene and octree",
        "nodes on four deepest levels",
        "accesses to them",
        "without them: tests",
        "operations",
        "only four top levels: tests",
        "operations",
    ]);
    table.row(vec![
        "published".to_owned(),
        percent(published::DEEPEST_NODES_SHARE, 1),
        percent(published::DEEPEST_ACCESSES_SHARE, 1),
        String::new(),
        format!("{:.0}x", published::FLOPS_FACTOR),
    ]);
    for figure in figures {
        let times = |factor: f64| format!("{factor:.2}x");
        table.row(vec![
            format!("{}, {}", figure.scene, octree(figure.octree)),
            percent(figure.deepest.nodes_share, 1),
            percent(figure.deepest.accesses_share, 2),
            times(figure.without_deepest.primitive_tests),
            times(figure.without_deepest.flops),
            times(figure.only_top.primitive_tests),
            times(figure.only_top.flops),
        ]);
    }
    writeln!(out, "{table}")
}

/// Those of a scene.
fn of<'a>(all: &'a [Traffic], scene: &PaperScene) -> Vec<&'a Traffic> {
    let name = scene.source().to_string();
    all.iter().filter(|traffic| traffic.conditions.scene == name).collect()
}

fn traffic(out: &mut String, scene: &PaperScene, paper: &Paper) -> std::fmt::Result {
    let shown = of(&paper.traffic, scene);
    let Some(first) = shown.first() else { return Ok(()) };
    writeln!(
        out,
        "{}  Bytes on the cluster bus by size of the local memory: {}, {}, database of {} bytes,\n\
         lines of {LINE}, interleaved. The paper's curves bear no numbers.\n",
        scene.figure.to_uppercase(),
        scene.source(),
        octree(first.conditions.octree),
        grouped(first.conditions.database_bytes)
    )?;
    let head = shown.iter().map(|traffic| format!("{} nodes", traffic.nodes));
    let mut table =
        Table::columns(["local memory".to_owned(), "bytes of one".to_owned()].into_iter().chain(head).collect());
    for (i, size) in first.sizes.iter().enumerate() {
        let bytes = shown.iter().map(|traffic| grouped(traffic.sizes[i].bus_bytes));
        let name = size.local_memory.to_string();
        table.row([name, grouped(size.local_bytes)].into_iter().chain(bytes).collect());
    }
    let messages = shown.iter().map(|traffic| grouped(traffic.messages.bytes()));
    table.row(["messages, besides".to_owned(), String::new()].into_iter().chain(messages).collect());
    if scene.scene == TEAPOT.scene {
        let about = format!("about {}", grouped(published::MESSAGE_BYTES_ABOUT));
        table.row(vec!["published".to_owned(), String::new(), String::new(), about]);
    }
    writeln!(out, "{table}")
}

fn replacements(out: &mut String, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "OTHER REPLACEMENT  Misses / record accesses, {} nodes, lines of {LINE}, interleaved\n",
        published::TABLE_NODES
    )?;
    let sizes = published::TABLE_SIZES.map(|size| size.to_string());
    let [a, b, c, d] = sizes.each_ref().map(String::as_str);
    let mut table = Table::new(["scene", "octree", "replacement", a, b, c, d]);
    for replaced in &paper.replacements {
        for (policy, ratios) in replaced.by_policy() {
            let head = [replaced.scene.clone(), octree(replaced.octree), format!("{policy:?}").to_lowercase()];
            table.row(head.into_iter().chain(ratios.iter().map(|ratio| format!("{ratio:.4}"))).collect());
        }
    }
    writeln!(out, "{table}")
}

fn claims(out: &mut String, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "FURTHER CLAIMS  Simulated, tiles on demand, local memories of {SMALLEST}, lines of {LINE}. \"Intrinsically load balanced\": how\n\
         busy nodes are, and the busiest over the mean. \"Its task is negligible\", \"no bottleneck should occur\": shares of time in\n\
         which the bus is held for the master's jobs, for pixels on their way to the display, and for fetches. \"Less than 10%\": one\n\
         processor's build of the octree, of the whole; a primitive against a cell's octants is taken for a primitive test.\n"
    )?;
    let mut table = Table::new(["scene", "nodes", "busy", "busiest / mean", "jobs", "pixels", "fetches", "build"]);
    for claims in &paper.claims {
        for balance in &claims.by_nodes {
            table.row(vec![
                claims.scene.clone(),
                balance.nodes.to_string(),
                percent(balance.busy, 1),
                format!("{:.3}", balance.busiest_over_mean),
                percent(balance.jobs, 2),
                percent(balance.pixels, 2),
                percent(balance.fetches, 1),
                percent(balance.build, 1),
            ]);
        }
    }
    writeln!(out, "{table}")?;
    writeln!(
        out,
        "\"HERO decreases … the number of manipulations of pointers\": the common-ancestor technique reads the same nodes, and ascends\n\
         step by step where HERO pops a node from its stack. A uniform grid is absent: the paper compares its memory alone.\n"
    )?;
    let mut table = Table::new(["scene", "nodes read per ray", "ascents per ray", "pointers saved"]);
    for claims in &paper.claims {
        let (reads, ascents) = (claims.nodes_read_per_ray, claims.ascents_per_ray);
        let saved = percent(ascents / (reads + ascents), 1);
        table.row(vec![claims.scene.clone(), format!("{reads:.2}"), format!("{ascents:.2}"), saved]);
    }
    writeln!(out, "{table}")
}

/// Simulation and formula side by side.
pub(in crate::study) fn contentions(out: &mut String, all: &[Contention]) -> std::fmt::Result {
    let Some(Contention { processor, bus, .. }) = all.first() else { return Ok(()) };
    writeln!(
        out,
        "CONTENTION  Nodes that share a bus, in simulated cycles; LRU, tiles on demand, row by row. A processor takes {} \
         cycles an\noctree node, {} a primitive test, {} a shading, {} a record read; a bus word of {} bytes takes {}, after a \
         latency of {};\nthe bus is {}, granted {}. Each simulated figure stands before what queueing\ntheory expects of a closed \
         network with the same mean times: services all the same (M/D/1//N), or exponential (MVA).\n",
        processor.octree_node,
        processor.primitive_test,
        processor.shading,
        processor.local_access,
        bus.width,
        bus.cycles_per_word,
        bus.latency,
        match bus.transactions {
            Transactions::Locked => "held meanwhile",
            Transactions::Split => "free meanwhile",
        },
        match bus.arbiter {
            Arbiter::Fifo => "first come, first served",
            Arbiter::RoundRobin { .. } => "round robin",
            Arbiter::FixedPriority => "the lowest node first",
        }
    )?;
    for contention in all {
        contention_table(out, contention)?;
    }
    Ok(())
}

fn contention_table(out: &mut String, contention: &Contention) -> std::fmt::Result {
    let Contention { conditions, local_memory, table: found, .. } = contention;
    writeln!(out, "{}, lines of {}, local memory {local_memory}", conditions.subject(), conditions.line_bytes)?;
    let mut table = Table::new([
        "nodes",
        "p",
        "1/p",
        "N*",
        "speed-up",
        "efficiency",
        "fixed",
        "exponential",
        "bus held",
        "fixed",
        "exponential",
        "mean wait",
        "fixed",
        "exponential",
        "99% wait",
    ]);
    for row in &found.rows {
        table.row(vec![
            row.setting.nodes.to_string(),
            format!("{:.4}", row.misses_per_record_access),
            format!("{:.1}", row.saturation),
            format!("{:.1}", row.knee),
            format!("{:.2}", row.speed_up),
            percent(row.efficiency, 1),
            percent(row.fixed_efficiency, 1),
            percent(row.exponential_efficiency, 1),
            percent(row.bus_utilisation, 1),
            percent(row.fixed_utilisation, 1),
            percent(row.exponential_utilisation, 1),
            format!("{:.1}", row.wait_mean),
            format!("{:.1}", row.fixed_wait),
            format!("{:.1}", row.exponential_wait),
            row.wait_percentile_99.to_string(),
        ]);
    }
    let nodes = |nodes: Option<u16>| nodes.map_or_else(|| "none".to_owned(), |nodes| nodes.to_string());
    writeln!(
        out,
        "{table}Of these numbers the largest at 90% efficiency: {} simulated, {} by the formula for fixed service.\n",
        nodes(found.largest_efficient),
        nodes(found.largest_efficient_formula)
    )
}

fn widths(out: &mut String, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "BUS WIDTH  The paper's {} nodes at {SMALLEST}, simulated as above on other buses\n",
        published::PROCESSORS
    )?;
    let mut table =
        Table::new(["scene", "octree", "line", "bus bytes", "speed-up", "efficiency", "fixed", "bus held", "N*"]);
    for Contention { conditions, bus, table: found, .. } in &paper.widths {
        for row in &found.rows {
            table.row(vec![
                conditions.scene.clone(),
                octree(conditions.octree),
                conditions.line_bytes.to_string(),
                bus.width.to_string(),
                format!("{:.1}", row.speed_up),
                percent(row.efficiency, 1),
                percent(row.fixed_efficiency, 1),
                percent(row.bus_utilisation, 1),
                format!("{:.1}", row.knee),
            ]);
        }
    }
    write!(out, "{table}")
}
