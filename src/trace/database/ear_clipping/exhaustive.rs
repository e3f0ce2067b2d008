//! The best triangles of an outline, in cubic time (after Klincsek 1980, and Shor and van Wyk 1992).

use super::outline::Outline;

/// A millisecond or two.
const VERTICES_MAX: u32 = 100;

/// n − 2 triangles that an outline is made of, those of them that are clockwise as small as can be; `None` for an
/// outline that is too large to look for them.
pub(super) fn triangles(outline: &Outline) -> Option<Vec<[u32; 3]>> {
    let n = outline.count();
    if !(3..=VERTICES_MAX).contains(&n) {
        return None;
    }
    // For each chain of vertices, closed by an edge: how much of its triangles is clockwise, and the third corner
    // of the one at that edge.
    let mut best = vec![(0.0f64, 0); (n * n) as usize];
    let at = |first: u32, last: u32| (first * n + last) as usize;
    for length in 2..n {
        for first in 0..n - length {
            let last = first + length;
            let clockwise = |middle: u32| {
                let own = (-outline.turn(first, middle, last)).max(0.0);
                own + best[at(first, middle)].0 + best[at(middle, last)].0
            };
            let all = (first + 1..last).map(|middle| (clockwise(middle), middle));
            best[at(first, last)] = all.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        }
    }
    let mut triangles = Vec::with_capacity(n as usize - 2);
    let mut rest = vec![(0, n - 1)];
    while let Some((first, last)) = rest.pop() {
        if last > first + 1 {
            let (_, middle) = best[at(first, last)];
            triangles.push([first, middle, last]);
            rest.extend([(middle, last), (first, middle)]);
        }
    }
    Some(triangles)
}
