//! The summary that a person reads at the end of a run.

use std::fmt::{self, Display, Write};

use super::{Kernel, Report, Status, Verification, incident};
use machine::hardware::local_memory::MemoryShape;

/// Several lines, each with a name in front.
pub fn summary(report: &Report) -> String {
    let mut text = String::new();
    // Writing into a string does not fail.
    let _ = write_summary(&mut text, report);
    text
}

fn write_summary(out: &mut String, report: &Report) -> fmt::Result {
    let Report { scene, image, rays, octree, seconds, .. } = report;
    line(
        out,
        "scene",
        format_args!(
            "{}, {} primitives, database {}",
            incident::line(&scene.source),
            Grouped(scene.primitives),
            Bytes(scene.database_bytes)
        ),
    )?;
    line(
        out,
        "octree",
        format_args!(
            "{} nodes, {} leaves, {} references, depth {}",
            Grouped(octree.nodes),
            Grouped(octree.leaves),
            Grouped(octree.references),
            octree.depth
        ),
    )?;
    match report.kernel {
        None => {}
        Some(Kernel::Single) => line(out, "kernel", format_args!("single rays"))?,
        Some(Kernel::Packets { simd, derived_bytes }) => line(
            out,
            "kernel",
            format_args!(
                "packets, {simd}, derived octree {}, {:.1} bytes a primitive",
                Bytes(derived_bytes),
                super::ratio(derived_bytes as f64, scene.primitives as f64)
            ),
        )?,
    }
    line(
        out,
        "rays",
        format_args!(
            "{}: {} primary, {} shadow, {} reflection, {} refraction; {}/s",
            Grouped(rays.total()),
            Grouped(rays.primary),
            Grouped(rays.shadow),
            Grouped(rays.reflection),
            Grouped(rays.refraction),
            Grouped(report.rays_per_second() as u64)
        ),
    )?;
    if let Some(tests) = report.tests {
        line(
            out,
            "tests",
            format_args!(
                "{} of primitives, {} saved by the mailbox",
                Grouped(tests.primitive),
                Grouped(tests.mailbox_skips)
            ),
        )?;
        if tests.polygon_triangles > 0 {
            line(out, "polygons", format_args!("{} triangles tested within them", Grouped(tests.polygon_triangles)))?;
        }
    }
    write_cluster(out, report)?;
    line(
        out,
        "seconds",
        format_args!(
            "load {:.3}, octree {:.3}, render {:.3} ({:.3} of processor time), total {:.3}",
            seconds.load, seconds.octree, seconds.render, seconds.render_cpu, seconds.total
        ),
    )?;
    for incident in &report.incidents {
        // A report may have been read from a file.
        let text = incident::line(&incident.text);
        line(out, "incident", format_args!("at {:.1} s: {text}", incident.seconds))?;
    }
    match report.status {
        Status::Done => {}
        Status::TilesMissing => line(out, "status", format_args!("finished with tiles missing"))?,
        Status::Interrupted => line(out, "status", format_args!("interrupted, the image is partial"))?,
        Status::Failed => {
            line(out, "status", format_args!("failed: {}", report.error.as_deref().unwrap_or("unknown")))?
        }
    }
    if let Some(why) = &image.unverified {
        line(out, "unverified", format_args!("the image is not to be relied on: {why}"))?;
    }
    line(
        out,
        "image",
        format_args!("{}x{}, sha256 {}", image.width, image.height, image.sha256.as_deref().unwrap_or("unknown")),
    )?;
    image
        .files
        .iter()
        .try_for_each(|file| line(out, "", format_args!("{}", incident::line(&file.display().to_string()))))?;
    report
        .warnings
        .iter()
        .try_for_each(|warning| line(out, "warning", format_args!("{}", super::incident::line(&warning.to_string()))))
}

/// What only a run with processes has.
fn write_cluster(out: &mut String, report: &Report) -> fmt::Result {
    if let Some(tiles) = &report.tiles {
        line(
            out,
            "tiles",
            format_args!(
                "{} of {} by {} nodes, {} reissued, {} late duplicates",
                Grouped(tiles.done),
                Grouped(tiles.total),
                report.nodes.len(),
                Grouped(tiles.reissued),
                Grouped(tiles.stale)
            ),
        )?;
    }
    if let Some(memory) = &report.memory {
        line(
            out,
            "memory",
            format_args!(
                "{} per node in lines of {} bytes{}: {:.3}% of {} record accesses hit, {:.3}% of {} line accesses",
                Bytes(memory.shape.local_bytes),
                memory.line_bytes,
                sets(memory.shape),
                100.0 * memory.hit_rate(),
                Grouped(memory.record_accesses),
                100.0 * (1.0 - super::ratio(memory.line_misses as f64, memory.line_accesses as f64)),
                Grouped(memory.line_accesses)
            ),
        )?;
        line(
            out,
            "ratios",
            format_args!(
                "{:.3}% of record accesses miss, words moved are {:.3}% of words read",
                100.0 * memory.misses_per_record_access,
                100.0 * memory.words_moved_per_word_read
            ),
        )?;
    }
    if let Some(bus) = &report.bus {
        line(
            out,
            "bus",
            format_args!(
                "{} fetches, {} of data, {} of messages, {} on the wire, {} rows logged",
                Grouped(bus.fetches),
                Bytes(bus.bytes),
                Bytes(bus.message_bytes),
                Bytes(bus.wire_bytes),
                Grouped(bus.log_rows)
            ),
        )?;
    }
    if let Some(conservation) = &report.conservation {
        let failed: Vec<_> = conservation.checks.iter().filter(|check| !check.holds).collect();
        if failed.is_empty() {
            line(out, "conservation", format_args!("all {} checks hold", conservation.checks.len()))?;
        }
        for check in failed {
            line(out, "conservation", format_args!("BROKEN: {}: {} against {}", check.name, check.left, check.right))?;
        }
    }
    if let Some(verification) = &report.verification
        && verification.tiles > 0
    {
        let Verification { tiles, unverified_tiles, processes } = verification;
        let verified = processes.iter().filter(|process| process.latest_verified).count();
        line(
            out,
            "verified",
            format_args!(
                "{} of {} tiles by a second node; the latest tile of {verified} of {} processes",
                Grouped(*tiles),
                Grouped(tiles + unverified_tiles),
                processes.len()
            ),
        )?;
    }
    Ok(())
}

fn line(out: &mut String, name: &str, what: fmt::Arguments) -> fmt::Result {
    writeln!(out, "{name:<13}{what}")
}

/// A count with its digits in groups of three.
struct Grouped(u64);

impl Display for Grouped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = self.0.to_string();
        for (i, digit) in digits.chars().enumerate() {
            if i > 0 && (digits.len() - i).is_multiple_of(3) {
                f.write_char(',')?;
            }
            f.write_char(digit)?;
        }
        Ok(())
    }
}

/// Nothing where there is one: a fully associative memory.
fn sets(shape: MemoryShape) -> String {
    if shape.sets == 1 { String::new() } else { format!(", {} sets of {} ways", shape.sets, shape.lines_per_set) }
}

/// Bytes in the binary unit that leaves one to four digits.
struct Bytes(u64);

impl Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut amount = self.0 as f64;
        for unit in ["bytes", "KiB", "MiB", "GiB"] {
            if amount < 1024.0 {
                let decimals = usize::from(unit != "bytes");
                return write!(f, "{amount:.decimals$} {unit}");
            }
            amount /= 1024.0;
        }
        write!(f, "{amount:.1} TiB")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::conservation::{Check, Conservation};
    use crate::report::fixture;

    #[test]
    fn the_summary_says_what_a_reader_looks_for() {
        let text = summary(&fixture::report());
        for part in [
            "1,169 primitives, database 64.0 KiB",
            "packets, avx2, derived octree 91.3 KiB, 80.0 bytes a primitive",
            "12,345 of primitives, 678 saved by the mailbox",
            "5,600: 3,072 primary, 2,000 shadow, 500 reflection, 28 refraction; 2,800/s",
            "4 of 5 by 2 nodes, 1 reissued",
            "8.0 KiB per node in lines of 32 bytes, 64 sets of 4 ways: 89.796% of 980 record accesses hit",
            "10.204% of record accesses miss, words moved are 51.765% of words read",
            "103 fetches, 3.5 KiB of data",
            "all 1 checks hold",
            "1 of 4 tiles by a second node; the latest tile of 1 of 1 processes",
            "unverified   the image is not to be relied on: a = b: 1 against 2",
            "at 1.2 s: node 1 died: signal 9",
            "failed: the display died",
            "out/image.png\nwarning      a.obj:7:2: a face of two corners, is left out (and 2 more)\n",
        ] {
            assert!(text.contains(part), "no {part:?} in\n{text}");
        }
    }

    #[test]
    fn a_broken_check_is_shouted() {
        let mut report = fixture::report();
        report.conservation = Some(Conservation::new(vec![Check::new("in = out", 3, 4), Check::new("x", 1, 1)]));
        assert!(summary(&report).contains("BROKEN: in = out: 3 against 4"));
    }

    #[test]
    fn digits_are_grouped_from_the_right() {
        let grouped = [0, 999, 1000, 12_345, 1_234_567].map(|n| Grouped(n).to_string());
        assert_eq!(grouped, ["0", "999", "1,000", "12,345", "1,234,567"]);
    }
}
