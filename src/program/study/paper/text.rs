//! The study as text.

use std::fmt::Write;

use super::{Figure1, GEARS, Paper, PaperScene, TEAPOT};
use crate::study::figures::conditions::octree;
use crate::study::figures::contention::{Contention, SMALLEST};
use crate::study::figures::levels::{FLOPS_PER_TEST, FLOPS_PER_VISIT};
use crate::study::figures::traffic::{Size, Traffic};
use crate::study::page::table::{Table, grouped, percent};
use crate::study::published;
use machine::hardware::specification::{Arbiter, MemorySize, Transactions};
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
         reflections and refractions to depth {}. What the paper leaves open is tried in several ways and stands beside\n\
         each figure. Local memories are fully associative, tiles are dealt to nodes in turn, row by row (interleaved).\n",
        paper.tiling.tile_count(),
        paper.depth
    )?;
    figure1(out, &paper.figure1)?;
    for scene in [&GEARS, &TEAPOT] {
        traffic(out, scene, paper)?;
    }
    for scene in [&GEARS, &TEAPOT] {
        table1(out, scene, paper)?;
    }
    replacements(out, paper)?;
    sizes_in_bytes(out, paper)?;
    processors(out, paper)?;
    contentions(out, &paper.contention)?;
    widths(out, paper)
}

fn figure1(out: &mut String, figures: &[Figure1]) -> std::fmt::Result {
    for figure in figures {
        writeln!(out, "FIGURE 1  {}, {}\n", figure.scene, octree(figure.octree))?;
        let nodes: u64 = figure.levels.iter().map(|level| level.nodes).sum();
        let accesses: u64 = figure.levels.iter().map(|level| level.accesses).sum();
        let mut table = Table::new(["level", "nodes", "", "accesses", ""]);
        let mut row = |name: String, n: u64, a: u64| {
            let share = |part: u64, whole: u64| percent(part as f64 / whole.max(1) as f64, 2);
            table.row(vec![name, grouped(n), share(n, nodes), grouped(a), share(a, accesses)]);
        };
        for level in &figure.levels {
            row(level.level.to_string(), level.nodes, level.accesses);
        }
        row("all".to_owned(), nodes, accesses);
        writeln!(out, "{table}")?;
        let mut table = Table::new(["", "found", "published"]);
        let (found, published) = (figure.deepest, figure.published);
        let mut row = |name: &str, found: String, published: String| table.row(vec![name.to_owned(), found, published]);
        row("nodes on the four deepest levels", percent(found.nodes_share, 1), percent(published.nodes_share, 1));
        row("accesses to them", percent(found.accesses_share, 2), percent(published.accesses_share, 1));
        for (name, factor) in [
            ("the four deepest levels not built", &figure.without_deepest),
            ("nothing but the four top levels built", &figure.only_top),
        ] {
            row(name, String::new(), String::new());
            let mut cost = |name, times: f64, published: String| row(name, format!("{times:.2}x"), published);
            cost("  primitive tests", factor.primitive_tests, String::new());
            cost("  primitive tests, no mailbox", factor.primitive_tests_without_mailbox, String::new());
            cost("  floating point operations", factor.flops, format!("{:.0}x", figure.published_factor));
            cost("  the same, no mailbox", factor.flops_without_mailbox, String::new());
        }
        writeln!(
            out,
            "{table}Floating point operations are counted as {FLOPS_PER_VISIT} an octree node visited, {FLOPS_PER_TEST} a primitive test.\n"
        )?;
    }
    Ok(())
}

/// Those of a scene.
fn of<'a>(all: &'a [Traffic], scene: &PaperScene) -> Vec<&'a Traffic> {
    let name = scene.source().to_string();
    all.iter().filter(|traffic| traffic.conditions.scene == name).collect()
}

fn traffic(out: &mut String, scene: &PaperScene, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "{}  Bytes on the cluster bus by size of the local memory, {}; LRU. The paper's curves bear no numbers.\n",
        scene.figure.to_uppercase(),
        scene.source()
    )?;
    let all = of(&paper.traffic, scene);
    for &tree in scene.octrees {
        let shown: Vec<_> = all.iter().filter(|traffic| traffic.conditions.octree == tree).collect();
        let Some(first) = shown.first() else { continue };
        writeln!(out, "{}, database of {} bytes", octree(tree), grouped(first.conditions.database_bytes))?;
        let head = shown.iter().map(|t| format!("{} nodes, lines of {}", t.nodes, t.conditions.line_bytes));
        let mut table =
            Table::columns(["local memory".to_owned(), "bytes of one".to_owned()].into_iter().chain(head).collect());
        for (i, size) in first.sizes.iter().enumerate() {
            let bytes = shown.iter().map(|traffic| grouped(traffic.sizes[i].bus_bytes));
            let name = size.local_memory.to_string();
            table.row([name, grouped(size.local_bytes)].into_iter().chain(bytes).collect());
        }
        let messages = shown.iter().map(|traffic| grouped(traffic.messages.bytes()));
        table.row(["messages, besides".to_owned(), String::new()].into_iter().chain(messages).collect());
        writeln!(out, "{table}")?;
    }
    Ok(())
}

fn table1(out: &mut String, scene: &PaperScene, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "TABLE 1  Shared memory accesses / local memory accesses, {}, {} nodes, LRU, under four definitions of the ratio\n",
        scene.source(),
        published::TABLE_NODES
    )?;
    let sizes = published::TABLE_SIZES.map(|size| size.to_string());
    let [a, b, c, d] = sizes.each_ref().map(String::as_str);
    let mut table = Table::new(["octree", "line", "ratio", a, b, c, d, "off by at most"]);
    let cells = |values: [f64; 4]| values.map(|value| format!("{value:.4}"));
    let mut row = |head: [String; 3], values: [f64; 4], off_by: String| {
        table.row(head.into_iter().chain(cells(values)).chain([off_by]).collect());
    };
    row(["published".to_owned(), String::new(), String::new()], scene.table, String::new());
    let name = scene.source().to_string();
    for found in paper.table1.iter().filter(|table| table.conditions.scene == name) {
        let head =
            [octree(found.conditions.octree), found.conditions.line_bytes.to_string(), found.ratio.name().to_owned()];
        row(head, found.found, format!("{:.2}x", found.off_by));
    }
    writeln!(out, "{table}")
}

fn replacements(out: &mut String, paper: &Paper) -> std::fmt::Result {
    writeln!(out, "OTHER REPLACEMENT  Misses / record accesses, {} nodes, lines of 64\n", published::TABLE_NODES)?;
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

fn sizes_in_bytes(out: &mut String, paper: &Paper) -> std::fmt::Result {
    writeln!(
        out,
        "THE BUS AT 1/32  The teapot, {} nodes, LRU: bytes on the bus over what one processor without a local memory\n\
         would read for the same tiles\n",
        published::TABLE_NODES
    )?;
    let mut table = Table::new([
        "octree",
        "line",
        "database",
        "1/32 of it",
        "bus bytes",
        "one processor",
        "share",
        "with messages",
        "messages",
    ]);
    let cell = |text: &str| text.to_owned();
    table.row(vec![
        cell("published"),
        String::new(),
        cell("about 2.8 MB"),
        format!("about {}", grouped(published::LOCAL_BYTES_ABOUT)),
        String::new(),
        String::new(),
        percent(published::BUS_SHARE, 1),
        String::new(),
        format!("about {}", grouped(published::MESSAGE_BYTES_ABOUT)),
    ]);
    let smallest = published::share(32);
    let shown = of(&paper.traffic, &TEAPOT).into_iter().filter(|traffic| traffic.nodes == published::TABLE_NODES);
    for (traffic, size) in shown.filter_map(|traffic| Some((traffic, traffic.size(smallest)?))) {
        table.row(bus_row(traffic, size));
    }
    writeln!(out, "{table}")
}

fn bus_row(traffic: &Traffic, size: &Size) -> Vec<String> {
    let [data, with_messages] = traffic.bus_shares(size);
    vec![
        octree(traffic.conditions.octree),
        traffic.conditions.line_bytes.to_string(),
        grouped(traffic.conditions.database_bytes),
        grouped(size.local_bytes),
        grouped(size.bus_bytes),
        grouped(traffic.unique_processor_bytes),
        percent(data, 2),
        percent(with_messages, 2),
        grouped(traffic.messages.bytes()),
    ]
}

fn processors(out: &mut String, paper: &Paper) -> std::fmt::Result {
    let smallest: MemorySize = published::share(32);
    writeln!(
        out,
        "THIRTY-SEVEN PROCESSORS  1/p at {smallest}, {} nodes, LRU. The paper's 37 is 1/0.027, the gears' cell of Table 1;\n\
         the teapot's, 0.047, gives 21. 1/p is where the bus is never idle if processors do nothing but access, and if an\n\
         access to the shared memory holds the bus for as long as one to the local memory takes. By accesses, a miss\n\
         then takes as long as a local record access: with a local memory of a word a cycle that presupposes a bus of so\n\
         many bytes a cycle, without latency. By words, it presupposes four.\n",
        published::TABLE_NODES
    )?;
    let mut table = Table::new([
        "scene",
        "octree",
        "line",
        "p, accesses",
        "1/p",
        "p, words",
        "1/p",
        "words an access",
        "bytes a miss",
        "bus bytes a cycle",
    ]);
    for found in &paper.processors {
        table.row(vec![
            found.conditions.scene.clone(),
            octree(found.conditions.octree),
            found.conditions.line_bytes.to_string(),
            format!("{:.4}", found.misses_per_access),
            format!("{:.1}", found.by_accesses),
            format!("{:.4}", found.words_moved_per_word_read),
            format!("{:.1}", found.by_words),
            format!("{:.2}", found.words_an_access),
            format!("{:.1}", found.bytes_a_miss),
            format!("{:.1}", found.presupposed_bus_bytes),
        ]);
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
