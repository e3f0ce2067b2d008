//! Where misses come from.

use crate::replay::Trace;
use crate::replay::model::detail::Classes;
use crate::replay::model::replayer::{Counters, Tally};
use crate::replay::origin::pixels::Pixels;
use trace::database::records::LEVELS;
use trace::database::{Layout, Section};
use trace::picture::Tiling;
use trace::tracer::RayKind;

/// Counts of accepted tiles, by what was read and what for. Each of the tables adds up to the same.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Origins {
    /// By [`Section`].
    pub sections: [Counters; Section::COUNT],
    /// Of octree nodes, by their level; the root is on level 0.
    pub levels: [Counters; LEVELS],
    /// By [`RayKind`].
    pub kinds: [Counters; RayKind::COUNT],
    /// By tile.
    pub tiles: Vec<Counters>,
    /// By pixel of the image, row by row.
    pub pixels: Vec<PixelCounts>,
}

/// What was read for a pixel.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct PixelCounts {
    pub record_accesses: u64,
    /// Of these, octree nodes.
    pub octree_accesses: u64,
    pub record_misses: u64,
}

/// Counts [`Origins`] while a trace is replayed, of as many memories as wanted one after the other.
pub struct OriginsTally<'a, T: ?Sized> {
    trace: &'a T,
    classes: Classes<'a>,
    tiling: Tiling,
    place: Pixels,
    /// The tile, if it counts.
    tile: Option<usize>,
    kind: RayKind,
    /// In the image, if it is there.
    pixel: Option<usize>,
    pub origins: Origins,
}

impl<'a, T: Trace + ?Sized> OriginsTally<'a, T> {
    /// `levels`: by block of eight octree words, the level that its nodes are on.
    pub fn new(trace: &'a T, layout: &Layout, levels: &'a [u8], tiling: Tiling) -> Self {
        let pixels = tiling.sides().width as usize * tiling.sides().height as usize;
        Self {
            trace,
            classes: Classes::new(layout, levels),
            tiling,
            place: Pixels::new(tiling),
            tile: None,
            kind: RayKind::Primary,
            pixel: None,
            origins: Origins {
                sections: Default::default(),
                levels: Default::default(),
                kinds: Default::default(),
                tiles: vec![Counters::default(); tiling.tile_count() as usize],
                pixels: vec![PixelCounts::default(); pixels],
            },
        }
    }
}

impl<T: Trace + ?Sized> Tally for OriginsTally<'_, T> {
    fn tile(&mut self, tile: u32) {
        let traced = &self.trace.tiles()[tile as usize];
        self.place.tile(traced.tile);
        let counts = traced.accepted && traced.tile.0 < self.tiling.tile_count();
        self.tile = counts.then_some(traced.tile.0 as usize);
        self.kind = RayKind::Primary;
        self.pixel = None;
    }

    #[inline(always)]
    fn ray(&mut self, kind: RayKind) {
        self.kind = kind;
        self.place.ray(kind);
        self.pixel = self.place.place().map(|(x, y)| y as usize * self.tiling.sides().width as usize + x as usize);
    }

    #[inline(always)]
    fn read(&mut self, record: u32, lines: u32, missing: u32) {
        let Some(tile) = self.tile else { return };
        let one = Counters {
            record_accesses: 1,
            record_misses: u64::from(missing > 0),
            line_accesses: u64::from(lines),
            line_misses: u64::from(missing),
        };
        let (section, index) = self.classes.place(record);
        let octree = section == Section::OctreeNodes;
        let origins = &mut self.origins;
        origins.sections[section as usize].add(&one);
        if octree {
            origins.levels[self.classes.level(index) as usize].add(&one);
        }
        origins.kinds[self.kind as usize].add(&one);
        origins.tiles[tile].add(&one);
        if let Some(pixel) = self.pixel {
            let pixel = &mut origins.pixels[pixel];
            pixel.record_accesses += 1;
            pixel.octree_accesses += u64::from(octree);
            pixel.record_misses += one.record_misses;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hardware::local_memory::Geometry;
    use crate::hardware::replacement::Lru;
    use crate::recording::references::octree_levels;
    use crate::replay::model::detail::Detail;
    use crate::replay::model::replayer::{Replayer, Sum};
    use crate::replay::stream::captured::tests::teapot;
    use crate::replay::{Captured, Lines, RecordLines};
    use trace::picture::Sides;

    const TILING: Tiling =
        Tiling::new(Sides { width: 32, height: 32, tile_width: 8, tile_height: 8 }).expect("possible");

    fn replay(trace: &Captured, layout: &Layout, tally: &mut impl Tally) {
        let lines = RecordLines::new(layout, 32);
        let geometry = Geometry { line_bytes: 32, database_lines: lines.count(), sets: 1, ways: 150 };
        let mut replayer = Replayer::<Lru, _>::new(&lines, geometry, 0).expect("few slots");
        (0..trace.tiles.len() as u32).for_each(|tile| replayer.tile(trace, tile, tally).expect("kept"));
    }

    fn sum<'a>(counts: impl IntoIterator<Item = &'a Counters>) -> Counters {
        counts.into_iter().fold(Counters::default(), |mut sum, counts| {
            sum.add(counts);
            sum
        })
    }

    #[test]
    fn every_table_adds_up_to_the_totals_and_agrees_with_a_nodes_counters() {
        let (database, mut trace) = teapot(32, 1);
        trace.tiles[5].accepted = false;
        let layout = &database.database().header.layout;
        let levels = octree_levels(&database);
        let mut tally = OriginsTally::new(&trace, layout, &levels, TILING);
        replay(&trace, layout, &mut tally);
        let mut totals = Sum::new(&trace);
        replay(&trace, layout, &mut totals);
        let totals = totals.finish();
        let Origins { sections, levels: by_level, kinds, tiles, pixels } = &tally.origins;
        assert_eq!([sum(sections), sum(kinds), sum(tiles)], [totals; 3]);
        assert_eq!(sum(by_level), sections[Section::OctreeNodes as usize]);
        assert!(totals.record_misses > 0 && by_level[0].record_accesses > 0);
        assert_eq!(tiles[5], Counters::default(), "a lost tile counts for nothing");
        assert_eq!(pixels.iter().map(|pixel| pixel.record_accesses).sum::<u64>(), totals.record_accesses);
        assert_eq!(pixels.iter().map(|pixel| pixel.record_misses).sum::<u64>(), totals.record_misses);
        let octree: u64 = pixels.iter().map(|pixel| pixel.octree_accesses).sum();
        assert_eq!(octree, sections[Section::OctreeNodes as usize].record_accesses);
        // Tile 6 is the third of the second row.
        let of_tile = |(i, _): &(usize, &PixelCounts)| (16..24).contains(&(i % 32)) && (8..16).contains(&(i / 32));
        let in_tile: u64 = pixels.iter().enumerate().filter(of_tile).map(|(_, pixel)| pixel.record_accesses).sum();
        assert_eq!(in_tile, tiles[6].record_accesses);

        let mut detail = Detail::new(&trace, Classes::new(layout, &levels));
        replay(&trace, layout, &mut detail);
        for (kind, counters) in detail.stats.counters.iter().enumerate() {
            assert_eq!(counters.iter().map(|c| c.record_misses).sum::<u64>(), kinds[kind].record_misses);
            assert_eq!(counters.iter().map(|c| c.line_misses).sum::<u64>(), kinds[kind].line_misses);
        }
    }
}
