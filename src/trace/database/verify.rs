//! A database that came from outside, checked once so that nothing after it need check again.

use super::records::{Cone, LeafEntry, Material, OctreeNode, OctreeWord, Polygon, Sphere, Surface, Triangle};
use super::{Database, Section};
use crate::database::records::MAX_DEPTH;

/// A record that points outside of its section, or an octree that is no tree.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the database is corrupt: {0}")]
pub struct Corrupt(pub String);

/// A database whose every index is in range, whose octree is a tree no deeper than its header says, and whose
/// primitives are where the octree is: the bounds of roundings rest on that.
#[derive(Clone, Debug)]
pub struct Verified {
    database: Database,
    /// Without padding; the same words where there is none.
    unpadded: Database,
}

impl Verified {
    /// Linear in the size of the image.
    ///
    /// # Errors
    /// The first thing found wrong.
    pub fn new(padded: Database) -> Result<Self, Corrupt> {
        let header = &padded.header;
        if padded.words.len() as u64 * 4 != header.layout.database_bytes() {
            return Err(Corrupt(format!(
                "{} bytes, expected {}",
                padded.words.len() as u64 * 4,
                header.layout.database_bytes()
            )));
        }
        let database = padded.unpadded();
        let header = &database.header;
        if header.max_depth > MAX_DEPTH {
            return Err(Corrupt(format!("octree depth {}, expected at most {MAX_DEPTH}", header.max_depth)));
        }
        let count = |section| header.layout.span(section).records;
        let primitives = count(Section::Triangles) + count(Section::Spheres) + count(Section::Cones);
        if count(Section::Surfaces) != primitives {
            return Err(Corrupt(format!("{} surfaces, expected {primitives}", count(Section::Surfaces))));
        }
        let mut objects = primitives;
        if header.layout.has_polygons() {
            objects = primitives - count(Section::Triangles) + count(Section::Polygons);
            check_polygons(database.records(Section::Polygons), count(Section::Triangles))?;
        }
        check_octree(&database)?;
        check_leaf_lists(database.records(Section::LeafLists), objects)?;
        check_coordinates(&database)?;
        check_materials(database.records(Section::Materials))?;
        check_surfaces(database.records(Section::Surfaces), count(Section::Materials), count(Section::Normals))?;
        Ok(Self { database: padded, unpadded: database })
    }

    pub fn database(&self) -> &Database {
        &self.database
    }

    /// [`Self::database`] without padding, whose records lie side by side.
    pub fn unpadded(&self) -> &Database {
        &self.unpadded
    }
}

/// They share out the triangles, in order.
fn check_polygons(polygons: &[Polygon], triangles: u64) -> Result<(), Corrupt> {
    let mut next = 0u64;
    for (id, polygon) in polygons.iter().enumerate() {
        if u64::from(polygon.first_triangle) != next || polygon.triangle_count == 0 {
            return Err(Corrupt(format!("{polygon:?} as polygon {id}, expected one that begins with triangle {next}")));
        }
        next += u64::from(polygon.triangle_count);
    }
    if next != triangles {
        return Err(Corrupt(format!("polygons of {next} triangles, expected {triangles}")));
    }
    Ok(())
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
    use crate::database::{Numbers, Objects, RecordLayout};
    use crate::scene::SceneSource;
    use crate::tracer::octree::{BuildParameters, build_database, build_database_as};

    /// Padding has no say in what is found wrong; what triangles a polygon has does.
    #[test]
    fn polygons_that_do_not_share_out_the_triangles_are_refused() {
        let source: SceneSource = "gears:1".parse().expect("procedural");
        let layout = RecordLayout::new(Objects::Polygons, Numbers::F64, Some(300)).expect("possible");
        let parameters = BuildParameters { leaf_size: 8, max_depth: 12 };
        let sound = build_database_as(&source.load().expect("procedural"), parameters, layout).expect("sound");
        let sound = sound.database();
        let polygons = (sound.header.layout.span(Section::Polygons).base.0 / 4) as usize;
        // The ground has two triangles, a gear's upper face 142.
        assert_eq!((&sound.words[polygons..][..2], &sound.words[polygons + 75..][..2]), (&[0, 2][..], &[2, 142][..]));
        for (word, value, expected) in [
            (0, 1, "expected one that begins with triangle 0"),
            (1, 1, "expected one that begins with triangle 1"),
            (1, 0, "expected one that begins with triangle 0"),
            (1, u32::MAX, "expected one that begins with triangle 4294967295"),
        ] {
            let mut database = sound.clone();
            Arc::make_mut(&mut database.words)[polygons + word] = value;
            let error = Verified::new(database).expect_err("not shared out").to_string();
            assert!(error.contains(expected), "{error}");
        }
        let mut padding = sound.clone();
        Arc::make_mut(&mut padding.words)[polygons + 2] = u32::MAX;
        Verified::new(padding).expect("padding is of no meaning");
    }

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
