//! The eager builder: a cell that holds too much is divided, depth first, children in octant order, so that
//! the words of a subtree and the lists of its leaves lie together.

use super::BuildParameters;
use super::octants::Octants;
use super::overlap::Cell;
use crate::database::compile::Records;
use crate::database::records::{LeafEntry, OctreeWord, PrimitiveId};

/// What the octree's sections may take at the most, in bytes: large polygons close to one another would
/// otherwise be listed in 4 times as many leaves with every level. With its records, at most 84 bytes, a
/// triangle takes 532.
pub const BYTES_A_PRIMITIVE: u64 = 448;
/// What they may take besides: nothing to a large scene, all that it wants to a small one.
pub const BYTES_FREE: u64 = 1 << 20;

/// The octree's two sections.
#[derive(Clone, Debug, Default)]
pub struct Octree {
    /// [`OctreeWord`]s.
    pub words: Vec<u32>,
    /// [`LeafEntry`]s.
    pub leaf_lists: Vec<u32>,
}

/// Builds the octree over all objects. The result is a function of the records and parameters alone.
///
/// A polygon overlaps the cells that any of its triangles does. So cells hold triangles, in the order of their ids, of which
/// those of one polygon follow one another and count once.
pub fn build(records: &Records, parameters: BuildParameters) -> Octree {
    let count = records.primitive_count();
    let mut builder = Builder {
        primitives: Octants::new(records),
        objects: objects(records),
        parameters,
        octree: Octree { words: vec![0; 8], leaf_lists: Vec::new() },
        cells: records.primitive_ids().map(|id| id.0).collect(),
        octants: Vec::new(),
    };
    let bytes_max = records.octree_bytes_max().min(BYTES_FREE + BYTES_A_PRIMITIVE * records.object_count() as u64);
    let root = builder.node(Cell::ROOT, 0, 0, count, bytes_max);
    builder.octree.words[0] = root.0;
    builder.octree
}

/// By primitive, the object that it is of; empty where every primitive is one by itself.
fn objects(records: &Records) -> Vec<u32> {
    let mut objects = Vec::new();
    if !records.polygons.is_empty() {
        objects.reserve_exact(records.primitive_count());
        for (id, polygon) in (0..).zip(&records.polygons) {
            objects.extend(polygon.triangles().map(|_| id));
        }
        let others = records.polygons.len() as u32..records.object_count() as u32;
        objects.extend(others);
    }
    objects
}

struct Builder<'a> {
    primitives: Octants<'a>,
    /// By primitive; empty where every primitive is an object by itself.
    objects: Vec<u32>,
    parameters: BuildParameters,
    octree: Octree,
    /// The primitives of the cells on the way down, a stack: the current cell's are on top.
    cells: Vec<u32>,
    /// Which octants each primitive of the current cell reaches; scratch.
    octants: Vec<u8>,
}

impl Builder<'_> {
    /// Makes the node of a cell whose primitives are `cells[first..end]`. When it and all below it are made,
    /// the octree has at most `bytes_max` bytes; a leaf fits into that.
    fn node(&mut self, cell: Cell, level: u32, first: usize, end: usize, bytes_max: u64) -> OctreeWord {
        if first == end {
            return OctreeWord::EMPTY;
        }
        let count = self.count(first, end);
        if count <= self.parameters.leaf_size as usize || level == self.parameters.max_depth {
            return self.leaf(first, end);
        }
        self.primitives.of(&self.cells[first..end], cell, &mut self.octants);
        let mut counts = [0; 8];
        for octants in &self.octants {
            for (octant, count) in counts.iter_mut().enumerate() {
                *count += usize::from(octants >> octant & 1);
            }
        }
        let held = if self.objects.is_empty() { counts } else { self.objects_by_octant(first) };
        // Where no child holds fewer than its parent, dividing further gains nothing.
        let least_bytes = 4 * (8 + held.iter().sum::<usize>() as u64);
        if held == [count; 8] || self.bytes() + least_bytes > bytes_max {
            return self.leaf(first, end);
        }
        self.branch(cell, level, first, counts, held, bytes_max)
    }

    /// How many objects `cells[first..end]` are of.
    fn count(&self, first: usize, end: usize) -> usize {
        if self.objects.is_empty() {
            return end - first;
        }
        self.cells[first..end].chunk_by(|&a, &b| self.objects[a as usize] == self.objects[b as usize]).count()
    }

    /// How many objects each octant holds of `cells[first..]`, which reach into `octants`.
    fn objects_by_octant(&self, first: usize) -> [usize; 8] {
        let (mut counts, mut newest) = ([0; 8], [u32::MAX; 8]);
        for (&id, &octants) in self.cells[first..].iter().zip(&self.octants) {
            let object = self.objects[id as usize];
            for octant in (0..8).filter(|octant| octants >> octant & 1 == 1) {
                counts[octant] += usize::from(std::mem::replace(&mut newest[octant], object) != object);
            }
        }
        counts
    }

    fn bytes(&self) -> u64 {
        4 * (self.octree.words.len() + self.octree.leaf_lists.len()) as u64
    }

    fn leaf(&mut self, first: usize, end: usize) -> OctreeWord {
        let at = self.octree.leaf_lists.len();
        if self.objects.is_empty() {
            let entry = |i: usize| LeafEntry::new(PrimitiveId(self.cells[i]), i + 1 == end).0;
            self.octree.leaf_lists.extend((first..end).map(entry));
        } else {
            let object = |i: usize| self.objects[self.cells[i] as usize];
            // The last primitive of each object stands for it.
            let objects = (first..end).filter(|&i| i + 1 == end || object(i) != object(i + 1));
            let entry = |i: usize| LeafEntry::new(PrimitiveId(object(i)), i + 1 == end).0;
            self.octree.leaf_lists.extend(objects.map(entry));
        }
        OctreeWord::leaf(at as u32)
    }

    /// `counts`: how many of the primitives, `cells[first..]`, each octant holds; `held`: how many objects.
    fn branch(
        &mut self,
        cell: Cell,
        level: u32,
        first: usize,
        counts: [usize; 8],
        held: [usize; 8],
        bytes_max: u64,
    ) -> OctreeWord {
        let block = self.octree.words.len() / 8;
        self.octree.words.extend([0; 8]);
        // The children's lists go onto the stack at once, since `octants` is reused further down.
        let bottom = self.cells.len();
        let mut ends = [bottom; 8];
        for octant in 1..8 {
            ends[octant] = ends[octant - 1] + counts[octant - 1];
        }
        let top = ends[7] + counts[7];
        self.cells.resize(top, 0);
        for (i, &octants) in self.octants.iter().enumerate() {
            let (id, mut rest) = (self.cells[first + i], octants);
            while rest != 0 {
                let end = &mut ends[rest.trailing_zeros() as usize];
                self.cells[*end] = id;
                *end += 1;
                rest &= rest - 1;
            }
        }
        // All children can be leaves. What is left over is shared by how many objects they hold, and what
        // one leaves of its share goes to the next.
        let all = held.iter().sum::<usize>() as u64;
        let bytes = self.bytes();
        let spare = (bytes_max - bytes - 4 * all) as f64 / all as f64;
        for octant in 0..8 {
            let held = held[..=octant].iter().sum::<usize>() as u64;
            let bytes_max = bytes + 4 * held + (spare * held as f64) as u64;
            let (from, to) = (ends[octant] - counts[octant], ends[octant]);
            self.octree.words[block * 8 + octant] = self.node(cell.child(octant), level + 1, from, to, bytes_max).0;
        }
        self.cells.truncate(bottom);
        OctreeWord::branch(block as u32)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::database::compile::compile;
    use crate::database::records::OctreeNode;
    use crate::scene::procedural::{Board, Kind, Procedural};
    use crate::scene::{Material, Polygon, Scene};
    use crate::tracer::octree::complete;

    const FINEST: BuildParameters = BuildParameters { leaf_size: 1, max_depth: 20 };

    /// Triangles as large as the root, one as hard to divide as the other.
    fn large_triangles(count: u32) -> Scene {
        let corner =
            |i: u32| DVec3::new(libm::sin(f64::from(i)), libm::sin(f64::from(2 * i)), libm::sin(f64::from(3 * i)));
        let polygon =
            |i| Polygon { first_vertex: 3 * i, vertex_count: 3, first_normal: None, first_colour: None, material: 0 };
        Scene {
            materials: vec![Material::WHITE],
            vertices: (0..3 * count).map(corner).collect(),
            polygons: (0..count).map(polygon).collect(),
            ..Scene::default()
        }
    }

    #[test]
    fn any_scene_is_below_600_bytes_a_primitive_and_a_mebibyte() {
        let procedural = |kind, size| Procedural { kind, size, board: Board::Squares }.scene();
        let scenes = [
            large_triangles(3000),
            procedural(Kind::Slivers, 2),
            procedural(Kind::Gears, 1),
            procedural(Kind::Teapot, 12),
            procedural(Kind::Corner, 8),
        ];
        for (i, scene) in scenes.iter().enumerate() {
            for parameters in [FINEST, BuildParameters { leaf_size: 8, max_depth: 12 }] {
                let records = compile(scene).expect("records");
                let (count, materials) = (records.primitive_count() as u64, records.materials.len() as u64);
                let octree = build(&records, parameters);
                let bytes = 4 * (octree.words.len() + octree.leaf_lists.len()) as u64;
                assert!(bytes <= BYTES_A_PRIMITIVE * count + BYTES_FREE, "scene {i}");
                let image = complete(records, parameters).expect("an image");
                let database_bytes = image.database().header.layout.database_bytes();
                assert!(database_bytes <= 600 * count + BYTES_FREE + 48 * materials, "scene {i}");
            }
        }
    }

    #[test]
    fn every_part_gets_its_share_of_what_the_octree_may_take() {
        let octree = build(&compile(&large_triangles(3000)).expect("records"), FINEST);
        let bytes = 4 * (octree.words.len() + octree.leaf_lists.len()) as u64;
        assert!(bytes * 10 > (BYTES_A_PRIMITIVE * 3000 + BYTES_FREE) * 9, "{bytes} bytes: little is left over");
        let Some(OctreeNode::Branch(root)) = OctreeWord(octree.words[0]).decode() else { panic!("a branch") };
        for child in &octree.words[8 * root as usize..][..8] {
            assert!(matches!(OctreeWord(*child).decode(), Some(OctreeNode::Branch(_))));
        }
    }
}
