//! Figure 1, and what "fourteenfold" may mean.

use serde::Serialize;

use super::{Paper, PaperError};
use crate::study::figures::levels::{self, Deepest, Effort, Level};
use crate::study::published;
use machine::replay::parallel;
use trace::scene::SceneSource;
use trace::tracer::octree::Octree;
use trace::tracer::octree::census::Census;

/// One octree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure1 {
    pub scene: String,
    #[serde(flatten)]
    pub octree: Octree,
    pub levels: Vec<Level>,
    pub deepest: Deepest,
    pub published: Deepest,
    /// With all levels.
    pub effort: Effort,
    /// "If these lowest levels are not built, the cost … increases fourteenfold": as it is written.
    pub without_deepest: Factor,
    /// The other reading: nothing but as many top levels.
    pub only_top: Factor,
    pub published_factor: f64,
}

/// What fewer levels cost, in multiples of what all of them cost.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Factor {
    pub effort: Effort,
    pub primitive_tests: f64,
    pub flops: f64,
    /// As if there were no mailbox.
    pub primitive_tests_without_mailbox: f64,
    pub flops_without_mailbox: f64,
}

impl Factor {
    fn new(effort: Effort, all: &Effort) -> Self {
        let times = |of: &dyn Fn(&Effort) -> u64| of(&effort) as f64 / (of(all) as f64).max(1.0);
        Self {
            effort,
            primitive_tests: times(&|effort| effort.tests(true)),
            flops: times(&|effort| effort.flops(true)),
            primitive_tests_without_mailbox: times(&|effort| effort.tests(false)),
            flops_without_mailbox: times(&|effort| effort.flops(false)),
        }
    }
}

/// Of scenes with their octrees.
pub(super) fn figures(of: &[(SceneSource, Octree)], paper: &Paper) -> Result<Vec<Figure1>, PaperError> {
    parallel::map(of, |(scene, octree)| figure(scene, *octree, paper)).into_iter().collect()
}

fn figure(scene: &SceneSource, octree: Octree, paper: &Paper) -> Result<Figure1, PaperError> {
    let trace = |octree: Octree| {
        let prepared = paper.prepare(scene, octree)?;
        let stats = levels::trace(&prepared.database, &prepared.view, paper.tiling, octree.mailbox);
        Ok::<_, PaperError>((Census::of(&prepared.database), stats))
    };
    let (census, stats) = trace(octree)?;
    let effort = Effort::new(&census, &stats);
    let fewer = |levels: u32| {
        let (census, stats) = trace(Octree { max_depth: levels.saturating_sub(1), ..octree })?;
        Ok::<_, PaperError>(Factor::new(Effort::new(&census, &stats), &effort))
    };
    let by_level = levels::levels(&census, &stats.octree_accesses);
    Ok(Figure1 {
        scene: scene.to_string(),
        octree,
        deepest: levels::deepest(&by_level, published::DEEPEST_LEVELS),
        published: Deepest {
            nodes_share: published::DEEPEST_NODES_SHARE,
            accesses_share: published::DEEPEST_ACCESSES_SHARE,
        },
        without_deepest: fewer(effort.levels.saturating_sub(published::DEEPEST_LEVELS))?,
        only_top: fewer(published::DEEPEST_LEVELS)?,
        published_factor: published::FLOPS_FACTOR,
        levels: by_level,
        effort,
    })
}
