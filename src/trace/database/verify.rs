//! A database that came from outside, checked once so that nothing after it need check again.

use super::records::{Cone, LeafEntry, Material, OctreeNode, OctreeWord, Sphere, Surface, Triangle};
use super::{Database, Section};
use crate::database::records::MAX_DEPTH;

/// A record that points outside of its section, or an octree that is no tree.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the database is corrupt: {0}")]
pub struct Corrupt(pub String);

/// A database whose every index is in range, whose octree is a tree no deeper than its header says, and whose
/// primitives are where the octree is: the bounds of roundings rest on that.
#[derive(Clone, Debug)]
pub struct Verified(Database);

impl Verified {
    /// Linear in the size of the image.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn new(database: Database) -> Result<Self, Corrupt> {
        let header = &database.header;
        if database.words.len() as u64 * 4 != header.layout.database_bytes() {
            return Err(Corrupt(format!(
                "{} bytes, expected {}",
                database.words.len() as u64 * 4,
                header.layout.database_bytes()
            )));
        }
        if header.max_depth > MAX_DEPTH {
            return Err(Corrupt(format!("octree depth {}, expected at most {MAX_DEPTH}", header.max_depth)));
        }
        let count = |section| header.layout.span(section).records;
        let primitives = count(Section::Triangles) + count(Section::Spheres) + count(Section::Cones);
        if count(Section::Surfaces) != primitives {
            return Err(Corrupt(format!("{} surfaces, expected {primitives}", count(Section::Surfaces))));
        }
        check_octree(&database)?;
        check_leaf_lists(database.records(Section::LeafLists), primitives)?;
        check_coordinates(&database)?;
        check_materials(database.records(Section::Materials))?;
        check_surfaces(database.records(Section::Surfaces), count(Section::Materials), count(Section::Normals))?;
        Ok(Self(database))
    }

    pub fn database(&self) -> &Database {
        &self.0
    }
}

/// Walks the tree from the root: every block has one parent, every leaf's list begins in range.
fn check_octree(database: &Database) -> Result<(), Corrupt> {
    let words: &[OctreeWord] = database.records(Section::OctreeNodes);
    let entries = database.header.layout.span(Section::LeafLists).records;
    let blocks = words.len() / 8;
    if words.is_empty() {
        return Err(Corrupt("no octree root".to_owned()));
    }
    let mut seen = vec![false; blocks];
    let mut rest = vec![(words[0], 0)];
    while let Some((word, level)) = rest.pop() {
        match word.decode() {
            Some(OctreeNode::EmptyLeaf) => {}
            Some(OctreeNode::Leaf(first)) if u64::from(first) < entries => {}
            Some(OctreeNode::Branch(block))
                if level < database.header.max_depth && (1..blocks).contains(&(block as usize)) =>
            {
                if std::mem::replace(&mut seen[block as usize], true) {
                    return Err(Corrupt(format!("octree block {block} has two parents")));
                }
                let first = block as usize * 8;
                rest.extend(words[first..first + 8].iter().map(|&child| (child, level + 1)));
            }
            _ => return Err(Corrupt(format!("octree node {:#010x} on level {level}", word.0))),
        }
    }
    Ok(())
}

/// Every list ends, since the last entry of all is the last of its leaf.
fn check_leaf_lists(entries: &[LeafEntry], primitives: u64) -> Result<(), Corrupt> {
    if entries.last().is_some_and(|e| !e.is_last()) {
        return Err(Corrupt("the last leaf list does not end".to_owned()));
    }
    match entries.iter().find(|e| u64::from(e.primitive().0) >= primitives) {
        Some(entry) => {
            Err(Corrupt(format!("primitive {} in a leaf, expected below {primitives}", entry.primitive().0)))
        }
        None => Ok(()),
    }
}

fn check_coordinates(database: &Database) -> Result<(), Corrupt> {
    // False for what is not a number.
    let is_inside = |coordinate: &f32| coordinate.abs() <= 1.0;
    // The end of a cone whose axis runs between three of the octree's may be wider than the root.
    let is_radius = |radius: &f32| radius.abs() <= 2.0;
    let triangles: &[Triangle] = database.records(Section::Triangles);
    let spheres: &[Sphere] = database.records(Section::Spheres);
    let cones: &[Cone] = database.records(Section::Cones);
    let outside = |kind: &str, id: usize| Corrupt(format!("{kind} {id} lies outside of the octree"));
    if let Some(id) = triangles.iter().position(|t| !t.coordinates.as_flattened().iter().all(is_inside)) {
        return Err(outside("triangle", id));
    }
    if let Some(id) = spheres.iter().position(|s| !(s.centre.iter().all(is_inside) && is_radius(&s.radius))) {
        return Err(outside("sphere", id));
    }
    let ends = |c: &Cone| {
        c.base.iter().chain(&c.apex).all(is_inside) && [&c.base_radius, &c.apex_radius].into_iter().all(is_radius)
    };
    match cones.iter().position(|c| !ends(c)) {
        Some(id) => Err(outside("cone", id)),
        None => Ok(()),
    }
}

fn check_surfaces(surfaces: &[Surface], materials: u64, normals: u64) -> Result<(), Corrupt> {
    let good = |s: &&Surface| {
        u64::from(s.material) < materials
            && s.is_known()
            && [s.colours(), s.normals()].into_iter().flatten().all(|index| u64::from(index) < normals)
    };
    match surfaces.iter().find(|s| !good(s)) {
        Some(s) => Err(Corrupt(format!("{s:?}, expected a material below {materials} and corners below {normals}"))),
        None => Ok(()),
    }
}

/// The light terms of the last material are there.
fn check_materials(materials: &[Material]) -> Result<(), Corrupt> {
    match materials.last() {
        Some(last) if last.has_light_terms() => Err(Corrupt("the last material lacks its light terms".to_owned())),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::scene::SceneSource;
    use crate::tracer::octree::{BuildParameters, build_database};

    /// Where the bounds of roundings would not hold, nothing is traced.
    #[test]
    fn a_primitive_outside_of_the_octree_is_refused() {
        for (scene, section, expected) in
            [("teapot:2", Section::Triangles, "triangle 1 lies"), ("balls:1", Section::Spheres, "sphere 2 lies")]
        {
            let source: SceneSource = scene.parse().expect("procedural");
            let scene = source.load().expect("procedural");
            let parameters = BuildParameters { leaf_size: 8, max_depth: 12 };
            let mut database = build_database(&scene, parameters).expect("sound").database().clone();
            // Ten words into the section: the second triangle's first coordinate, the third sphere's last.
            let word = (database.header.layout.span(section).base.0 / 4) as usize + 10;
            for bits in [1.5f32.to_bits(), f32::NAN.to_bits(), f32::NEG_INFINITY.to_bits()] {
                Arc::make_mut(&mut database.words)[word] = bits;
                let error = Verified::new(database.clone()).expect_err("outside").to_string();
                assert!(error.contains(expected), "{error}");
            }
        }
    }
}
