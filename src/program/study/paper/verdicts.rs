//! The paper's claims beside the study's own numbers, each with a verdict that follows from them.

use super::{Balance, Claims, Found, Paper};
use crate::study::figures::conditions::octree;
use crate::study::figures::contention::Contention;
use crate::study::page::Section;
use crate::study::page::grid::{Cell, Grid};
use crate::study::page::table::{grouped, percent};
use crate::study::published;

/// A number is consistent with a published one within this factor.
pub(super) const FACTOR_MAX: f64 = 1.25;
/// So are the eight cells of Table 1 together.
const CELLS_FACTOR_MAX: f64 = 1.4;
/// The busiest node is balanced with the mean up to this ratio, and a share of the bus's time negligible up to this one.
const BALANCED_MAX: f64 = 1.05;
const NEGLIGIBLE_MAX: f64 = 0.02;
/// "Less than 10%", section 2.2.
const BUILD_MAX: f64 = 0.1;
/// So efficient is "acceptable".
const EFFICIENCY_MIN: f64 = 0.9;

/// One claim.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Verdict {
    claim: String,
    found: String,
    verdict: String,
}

/// How far apart two numbers are.
pub(super) fn factor(found: f64, published: f64) -> f64 {
    (found / published).max(published / found)
}

/// The table of all claims.
pub(super) fn section(paper: &Paper) -> Section {
    let rows = verdicts(paper)
        .into_iter()
        .map(|Verdict { claim, found, verdict }| [claim, found, verdict].map(Cell::words).to_vec());
    let introduction = format!(
        "Consistent: a plausible setting gives the published number within a factor of {FACTOR_MAX} (Table 1: all cells within \
         {CELLS_FACTOR_MAX}). That does not reproduce it, as other settings may give it too, and different claims are met under \
         different settings. Balanced: the busiest node computes at most {} longer than the mean. Negligible: at most {} of the bus's \
         time. Acceptable: nodes are at least {} efficient.",
        percent(BALANCED_MAX - 1.0, 0),
        percent(NEGLIGIBLE_MAX, 0),
        percent(EFFICIENCY_MIN, 0)
    );
    let columns = ["the paper (1991)", "found here", "verdict"].map(str::to_owned).to_vec();
    Section { heading: "Verdicts".to_owned(), introduction, grid: Grid { columns, rows: rows.collect() } }
}

fn verdicts(paper: &Paper) -> Vec<Verdict> {
    let mut all = Vec::new();
    let best = paper.settings.iter().min_by(|a, b| a.rmse.total_cmp(&b.rmse));
    all.extend(best.into_iter().flat_map(of_table1));
    all.extend(of_figure1(paper));
    all.extend(paper.traffic.first().map(|traffic| {
        let (found, about) = (traffic.messages.bytes(), published::MESSAGE_BYTES_ABOUT);
        let verdict = judged(is_near(found as f64, about as f64));
        Verdict { claim: "messages: about 200 Kbytes".to_owned(), found: format!("{} bytes", grouped(found)), verdict }
    }));
    all.extend(of_claims(&paper.claims));
    all.extend(processors(&paper.contention));
    all
}

fn of_table1(best: &Found) -> [Verdict; 3] {
    let bytes = best.cells[1].least_local_bytes;
    let processors = best.processors();
    [
        Verdict {
            claim: "Table 1: eight cells".to_owned(),
            found: format!("one setting for both scenes is within {:.2}× of all: {}", best.worst, best.setting),
            verdict: judged(best.worst <= CELLS_FACTOR_MAX),
        },
        Verdict {
            claim: "1/32 of the teapot: about 87 Kbytes".to_owned(),
            found: format!("the same setting: {} bytes", grouped(bytes)),
            verdict: judged(is_near(bytes as f64, published::LOCAL_BYTES_ABOUT as f64)),
        },
        Verdict {
            claim: format!("{} processors, 1/p of the gears at 1/32", published::PROCESSORS),
            found: format!("the same setting: {processors:.1}"),
            verdict: judged(is_near(processors, f64::from(published::PROCESSORS))),
        },
    ]
}

/// The octree whose four deepest levels are nearest to both published shares.
fn of_figure1(paper: &Paper) -> Vec<Verdict> {
    let off = |figure: &&super::Figure1| {
        let (found, published) = (figure.deepest, figure.published);
        factor(found.nodes_share, published.nodes_share).max(factor(found.accesses_share, published.accesses_share))
    };
    let Some(figure) = paper.figure1.iter().min_by(|a, b| off(a).total_cmp(&off(b))) else { return Vec::new() };
    let (found, published) = (figure.deepest, figure.published);
    let (without, only) = (figure.without_deepest.flops, figure.only_top.flops);
    vec![
        Verdict {
            claim: format!(
                "Figure 1: {} of the nodes and {} of the accesses on the four deepest levels",
                percent(published.nodes_share, 1),
                percent(published.accesses_share, 1)
            ),
            found: format!(
                "{} and {}: {}, {}",
                percent(found.nodes_share, 1),
                percent(found.accesses_share, 1),
                figure.scene,
                octree(figure.octree)
            ),
            verdict: judged(off(&figure) <= FACTOR_MAX),
        },
        Verdict {
            claim: format!("without these levels, the cost is {}-fold", figure.published_factor),
            found: format!("{without:.1}×; {only:.1}× where nothing but the four top levels is built"),
            verdict: judged(is_near(without, figure.published_factor)),
        },
    ]
}

fn of_claims(claims: &[Claims]) -> Vec<Verdict> {
    let at = |nodes: u16| {
        claims.iter().filter_map(move |claims| {
            let balance = claims.by_nodes.iter().find(|balance| balance.nodes == nodes)?;
            Some((claims.scene.as_str(), *balance))
        })
    };
    let each = |nodes: u16, of: &dyn Fn(&Balance) -> String| {
        at(nodes).map(|(scene, balance)| format!("{scene}: {}", of(&balance))).collect::<Vec<_>>().join("; ")
    };
    let judge =
        |nodes: u16, of: &dyn Fn(&Balance) -> bool| by_scene(at(nodes).map(|(scene, balance)| (scene, of(&balance))));
    let nine = published::TABLE_NODES;
    let few = published::NODES[0];
    let is_negligible = |balance: &Balance| balance.jobs.max(balance.pixels) <= NEGLIGIBLE_MAX;
    vec![
        Verdict {
            claim: "the load is \"intrinsically\" balanced".to_owned(),
            found: format!(
                "busiest of {nine} nodes over the mean: {}",
                each(nine, &|balance| format!("{:.3}", balance.busiest_over_mean))
            ),
            verdict: judge(nine, &|balance| balance.busiest_over_mean <= BALANCED_MAX),
        },
        Verdict {
            claim: "the tasks of master and display are \"negligible\", \"no bottleneck\"".to_owned(),
            found: format!(
                "the bus of {nine} nodes, held for jobs and pixels: {}",
                each(nine, &|balance| format!("{} and {}", percent(balance.jobs, 2), percent(balance.pixels, 2)))
            ),
            verdict: judge(nine, &is_negligible),
        },
        Verdict {
            claim: format!("the octree's build is less than {} of the whole", percent(BUILD_MAX, 0)),
            found: format!("with {few} nodes: {}", each(few, &|balance| percent(balance.build, 1))),
            verdict: judge(few, &|balance| balance.build < BUILD_MAX),
        },
    ]
}

fn processors(contention: &[Contention]) -> Option<Verdict> {
    let nodes = published::PROCESSORS;
    let found: Vec<(&str, f64)> = contention
        .iter()
        .filter_map(|contention| {
            let row = contention.table.rows.iter().find(|row| u32::from(row.setting.nodes) == nodes)?;
            Some((contention.conditions.scene.as_str(), row.efficiency))
        })
        .collect();
    let shown: Vec<_> =
        found.iter().map(|(scene, efficiency)| format!("{scene}: {}", percent(*efficiency, 1))).collect();
    (!found.is_empty()).then(|| Verdict {
        claim: format!("{nodes} processors per cluster will be acceptable"),
        found: format!("efficiency in simulated cycles, by a cost model of ours: {}", shown.join("; ")),
        verdict: by_scene(found.iter().map(|&(scene, efficiency)| (scene, efficiency >= EFFICIENCY_MIN))),
    })
}

fn is_near(found: f64, published: f64) -> bool {
    factor(found, published) <= FACTOR_MAX
}

fn judged(is_consistent: bool) -> String {
    if is_consistent { "consistent" } else { "not consistent" }.to_owned()
}

/// For all scenes, for none, or for those that are named.
fn by_scene<'a>(scenes: impl Iterator<Item = (&'a str, bool)>) -> String {
    let (met, missed): (Vec<_>, Vec<_>) = scenes.partition(|scene| scene.1);
    let names = |of: &[(&str, bool)]| of.iter().map(|scene| scene.0).collect::<Vec<_>>().join(", ");
    match (met.is_empty(), missed.is_empty()) {
        (false, true) => judged(true),
        (true, _) => judged(false),
        (false, false) => format!("consistent for {}, not for {}", names(&met), names(&missed)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_follow_from_numbers() {
        assert_eq!((factor(2.0, 1.0), factor(1.0, 2.0)), (2.0, 2.0));
        assert!(is_near(36.0, 37.0) && is_near(37.0 * 1.25, 37.0) && !is_near(50.3, 37.0));
        assert_eq!(by_scene([("a", true), ("b", true)].into_iter()), "consistent");
        assert_eq!(by_scene([("a", false), ("b", false)].into_iter()), "not consistent");
        assert_eq!(by_scene([("a", true), ("b", false)].into_iter()), "consistent for a, not for b");
        assert_eq!(by_scene([].into_iter()), "not consistent");
    }

    #[test]
    fn a_claim_is_judged_per_scene() {
        let balance = |build| Balance {
            nodes: published::NODES[0],
            busy: 1.0,
            busiest_over_mean: 1.0,
            jobs: 0.0,
            pixels: 0.0,
            fetches: 0.0,
            build,
        };
        let claims = |scene: &str, build| Claims {
            scene: scene.to_owned(),
            by_nodes: vec![balance(build)],
            nodes_read_per_ray: 1.0,
            ascents_per_ray: 1.0,
        };
        let verdict = &of_claims(&[claims("gears", 0.047), claims("teapot", 0.166)])[2];
        assert_eq!(verdict.found, "with 4 nodes: gears: 4.7%; teapot: 16.6%");
        assert_eq!(verdict.verdict, "consistent for gears, not for teapot");
    }
}
