//! One node's local memory, over all that its processes traced.

use crate::hardware::local_memory::Geometry;
use crate::hardware::replacement::{Replacement, with_policy};
use crate::replay::TraceError;
use crate::replay::model::replayer::{Replayer, Tally};
use crate::replay::plan::setting::Policy;
use crate::replay::stream::subject::Subject;

/// Replays the processes of a node one after the other, each with an empty memory at its beginning.
///
/// # Errors
/// The trace's; optimal replacement, which no memory has that does not know what comes
/// ([`optimal`](crate::replay::model::optimal::optimal) counts it).
pub fn replay_node<S: Subject>(
    subject: &S,
    processes: &[Vec<u32>],
    policy: Policy,
    geometry: Geometry,
    tally: &mut impl Tally,
) -> Result<(), TraceError> {
    let Some(replacement) = policy.replacement() else {
        return Err(TraceError("optimal replacement only counts: expected another policy".to_owned()));
    };
    with_policy!(replacement, R => through::<R, _>(subject, processes, geometry, tally))
}

fn through<R: Replacement, S: Subject>(
    subject: &S,
    processes: &[Vec<u32>],
    geometry: Geometry,
    tally: &mut impl Tally,
) -> Result<(), TraceError> {
    let lines = subject.lines(geometry.line_bytes);
    let mut replayer = Replayer::<R, _>::new(&lines, geometry, subject.seed())?;
    for (epoch, tiles) in processes.iter().enumerate() {
        if epoch > 0 {
            replayer.clear();
        }
        tiles.iter().try_for_each(|&tile| replayer.tile(subject, tile, tally))?;
    }
    Ok(())
}
