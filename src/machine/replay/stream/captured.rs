//! A trace in memory: the references of tiles, made by tracing them here and now.

use std::convert::Infallible;

use crate::hardware::references::{RecordNumbers, Recorder};
use crate::replay::{Trace, TraceError, TracedTile};
use ground::ids::{Attempt, Epoch, NodeId, TileId};
use trace::database::verify::Verified;
use trace::picture::{AovSet, Tiling};
use trace::tracer::slices::Slices;
use trace::tracer::{TileTracer, View};

/// The references of an image that is traced now, all of them in memory: 4 bytes each.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Captured {
    pub tiles: Vec<TracedTile>,
    /// Words, by part.
    pub parts: Vec<Vec<u32>>,
}

impl Captured {
    /// Traces all tiles in order, each once, as if tile `i` were traced by node `i mod nodes`; all are accepted.
    ///
    /// # Panics
    /// There are no nodes, or `tiling` is not of the view's image.
    pub fn capture(database: &Verified, view: &View, tiling: Tiling, mailbox: bool, nodes: u16) -> Self {
        assert!(nodes > 0, "a capture for 0 nodes, expected at least 1");
        let sides = tiling.sides();
        assert_eq!(
            (sides.width, sides.height),
            (view.image.width(), view.image.height()),
            "the tiling's image beside the view's, expected the same width and height"
        );
        let header = &database.database().header;
        let numbers = RecordNumbers::new(&header.layout);
        let mut tracer = TileTracer::new(header, view, mailbox);
        let mut port = Slices::new(database);
        let mut captured = Self::default();
        let mut words = Vec::new();
        for (tile, rect) in (0..).map(TileId).map_while(|tile| tiling.rect(tile).map(|rect| (tile, rect))) {
            let mut parts = Vec::new();
            let mut recorder = Recorder::new(&mut port, numbers, &mut words, |part| parts.push(part.to_vec()));
            let Ok::<_, Infallible>(_) = tracer.trace(&mut recorder, rect, AovSet::default());
            parts.push(std::mem::take(&mut words));
            captured.push(NodeId((tile.0 % u32::from(nodes)) as u16), tile, parts);
        }
        captured
    }

    /// Appends a tile, accepted at its first attempt, of the node's first process.
    pub fn push(&mut self, node: NodeId, tile: TileId, parts: impl IntoIterator<Item = Vec<u32>>) {
        let first = self.parts.len() as u32;
        self.parts.extend(parts);
        let parts = first..self.parts.len() as u32;
        self.tiles.push(TracedTile { node, epoch: Epoch(0), tile, attempt: Attempt(0), accepted: true, parts });
    }
}

impl Trace for Captured {
    fn tiles(&self) -> &[TracedTile] {
        &self.tiles
    }

    fn read(&self, part: u32, words: &mut Vec<u32>) -> Result<(), TraceError> {
        let kept = self.parts.get(part as usize).ok_or_else(|| TraceError(format!("there is no part {part}")))?;
        words.clear();
        words.extend_from_slice(kept);
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::hardware::references::{Event, ReferenceWord};
    use trace::database::RecordLayout;
    use trace::picture::ImageSettings;
    use trace::picture::Sides;
    use trace::preparation;
    use trace::tracer::RayKind;

    /// The teapot at so many pixels a side in tiles of 8×8, and its database.
    pub(crate) fn teapot(side: u32, nodes: u16) -> (Verified, Captured) {
        scene("teapot", RecordLayout::DEFAULT, side, nodes)
    }

    /// The same of another scene, its records laid out like this.
    pub(crate) fn scene(name: &str, records: RecordLayout, side: u32, nodes: u16) -> (Verified, Captured) {
        let source = name.parse().expect("a procedural scene");
        let octree = trace::tracer::octree::Octree::DEFAULT;
        let choices = preparation::BuildChoices { octree, records };
        let image = ImageSettings::new(side, side, 4, 0.01).expect("possible");
        let prepared = preparation::prepare(&source, choices, &preparation::ViewChoices::default(), |_| Ok(image))
            .expect("a scene");
        let tiling = Tiling::new(Sides { width: side, height: side, tile_width: 8, tile_height: 8 }).expect("possible");
        let captured = Captured::capture(&prepared.database, &prepared.view, tiling, true, nodes);
        (prepared.database, captured)
    }

    #[test]
    #[should_panic(expected = "expected the same width and height")]
    fn a_tiling_of_another_image_is_refused() {
        let (database, _) = teapot(8, 1);
        let image = ImageSettings::new(8, 8, 4, 0.01).expect("possible");
        let scene = "teapot".parse::<trace::scene::SceneSource>().expect("a scene").load().expect("procedural");
        let view = preparation::view(&scene, &preparation::ViewChoices::default(), |_| Ok(image)).expect("a view");
        let tiling = Tiling::new(Sides { width: 16, height: 8, tile_width: 8, tile_height: 8 }).expect("possible");
        Captured::capture(&database, &view, tiling, true, 1);
    }

    #[test]
    fn every_pixel_begins_with_a_primary_ray_and_every_read_is_of_a_record() {
        let (database, captured) = teapot(20, 2);
        let records = RecordNumbers::new(&database.database().header.layout).count();
        assert_eq!(captured.tiles().len(), 9);
        let mut words = Vec::new();
        for (i, tile) in captured.tiles().iter().enumerate() {
            assert_eq!((tile.tile, tile.node), (TileId(i as u32), NodeId(i as u16 % 2)));
            let (mut pixels, mut reads) = (0, 0);
            for part in tile.parts.clone() {
                captured.read(part, &mut words).expect("kept");
                for &word in &words {
                    match ReferenceWord(word).decode().expect("of this version") {
                        Event::Ray(kind) => pixels += u32::from(kind == RayKind::Primary),
                        Event::Read(record) => {
                            reads += 1;
                            assert!(record < records);
                        }
                        other => panic!("{other:?} of a tracer"),
                    }
                }
            }
            let side = |place: u32| if place == 2 { 4 } else { 8 };
            assert_eq!(pixels, side(i as u32 % 3) * side(i as u32 / 3));
            assert!(reads >= pixels);
        }
        assert!(captured.read(captured.parts.len() as u32, &mut words).is_err());
    }
}
