//! Vertex normals of smoothing groups: where the faces of a group meet, their normals are averaged.

use glam::DVec3;

use crate::scene::Scene;

/// The faces of all groups that have no normals of their own.
#[derive(Default)]
pub(super) struct Smoothing {
    faces: Vec<Face>,
    /// Of the corners of all faces: which of the file's vertices each is.
    positions: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Face {
    group: u32,
    polygon: u32,
    /// Index into `positions`.
    first: u32,
    /// Where in the file it is. Files are smaller than 4 GiB.
    at: u32,
}

/// The sum at a vertex: of unit normals times angles, and of the angles.
#[derive(Clone, Copy, Default)]
struct Sum {
    normal: DVec3,
    angle: f64,
}

impl Smoothing {
    pub(super) fn add(&mut self, group: u32, polygon: u32, at: usize, positions: &[u32]) {
        self.faces.push(Face { group, polygon, first: self.positions.len() as u32, at: at as u32 });
        self.positions.extend_from_slice(positions);
    }

    /// Gives the faces their normals. A face of which one cancels out stays flat, and `flat` gets where it is.
    /// The sums are taken in the order of the file, whatever the groups are.
    pub(super) fn smooth(mut self, scene: &mut Scene, position_count: usize, mut flat: impl FnMut(usize)) {
        if self.faces.is_empty() {
            return;
        }
        self.faces.sort_by_key(|face| face.group);
        let mut sums = vec![Sum::default(); position_count];
        for group in self.faces.chunk_by(|a, b| a.group == b.group) {
            for face in group {
                self.corners(scene, face).iter().for_each(|&position| sums[position as usize] = Sum::default());
            }
            for face in group {
                let weighted = weighted_normals(scene.corners(&scene.polygons[face.polygon as usize]));
                for (&position, Sum { normal, angle }) in self.corners(scene, face).iter().zip(weighted) {
                    let sum = &mut sums[position as usize];
                    (sum.normal, sum.angle) = (sum.normal + normal, sum.angle + angle);
                }
            }
            for face in group {
                let first_normal = scene.normals.len();
                let corners = self.corners(scene, face);
                scene.normals.extend(corners.iter().map_while(|&position| sums[position as usize].direction()));
                if scene.normals.len() - first_normal == corners.len() {
                    scene.polygons[face.polygon as usize].first_normal = Some(first_normal as u32);
                } else {
                    scene.normals.truncate(first_normal);
                    flat(face.at as usize);
                }
            }
        }
    }

    fn corners(&self, scene: &Scene, face: &Face) -> &[u32] {
        &self.positions[face.first as usize..][..scene.polygons[face.polygon as usize].vertex_count as usize]
    }
}

impl Sum {
    /// `None` where nothing but rounding is left of the normals.
    fn direction(self) -> Option<DVec3> {
        const SHARE_MIN: f64 = 1e-9;
        if self.normal.length() > SHARE_MIN * self.angle { self.normal.try_normalize() } else { None }
    }
}

/// The unit normal of a polygon times the angle at each corner (Thürmer and Wüthrich 1998): how a surface is cut
/// into faces does not matter then. Zero for a polygon without area.
fn weighted_normals(corners: &[DVec3]) -> impl Iterator<Item = Sum> {
    let count = corners.len();
    let from_first = |i: usize| corners[i] - corners[0];
    let area: DVec3 = (1..count - 1).map(|i| from_first(i).cross(from_first(i + 1))).sum();
    let unit = area.try_normalize();
    let runs = Runs::of(corners);
    (0..count).map(move |i| {
        let (before, after, length) = runs.around(i);
        let edge = |to: usize| (corners[to] - corners[i]).try_normalize();
        let (Some(unit), Some(next), Some(previous)) = (unit, edge(after), edge(before)) else {
            return Sum::default();
        };
        let angle = libm::acos(next.dot(previous).clamp(-1.0, 1.0));
        let is_reflex = next.cross(previous).dot(unit) < 0.0;
        let angle = if is_reflex { std::f64::consts::TAU - angle } else { angle } / length as f64;
        Sum { normal: unit * angle, angle }
    })
}

/// Which corners of a polygon coincide with the one before them: the angle is shared out among these, so that a quadrilateral whose
/// side has shrunk to a point weighs as the triangle that it is.
struct Runs {
    count: usize,
    /// By corner the first and the last of its run, around the polygon; empty where no two coincide.
    ends: Vec<(usize, usize)>,
}

impl Runs {
    fn of(corners: &[DVec3]) -> Self {
        let count = corners.len();
        let joins = |i: usize| corners[i] == corners[(i + count - 1) % count];
        let Some(start) = (0..count).find(|&i| !joins(i)).filter(|_| (0..count).any(joins)) else {
            return Self { count, ends: Vec::new() };
        };
        let mut ends = vec![(0, 0); count];
        let mut first = start;
        for step in 0..count {
            let at = (start + step) % count;
            first = if joins(at) { first } else { at };
            ends[at].0 = first;
        }
        let mut last = (start + count - 1) % count;
        for step in (0..count).rev() {
            let at = (start + step) % count;
            last = if ends[at].0 == ends[last].0 { last } else { at };
            ends[at].1 = last;
        }
        Self { count, ends }
    }

    /// The corners before and after the run of one, and how many are in it.
    fn around(&self, corner: usize) -> (usize, usize, usize) {
        let (first, last) = self.ends.get(corner).copied().unwrap_or((corner, corner));
        let length = (last + self.count - first) % self.count + 1;
        ((first + self.count - 1) % self.count, (last + 1) % self.count, length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_of_a_polygon_weigh_its_normal() {
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let corners = l.map(|[x, y]| DVec3::new(x, y, 7.0));
        let angles: Vec<f64> = weighted_normals(&corners).map(|sum| sum.normal.z.to_degrees().round()).collect();
        assert_eq!(angles, [90.0, 90.0, 90.0, 270.0, 90.0, 90.0]);
        // A square with corners said twice and three times, the first of them at both ends.
        let repeated = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 1.0], [0.0, 1.0], [0.0, 0.0]];
        let square = repeated.map(|[x, y]| DVec3::new(x, y, 7.0));
        let angles: Vec<f64> = weighted_normals(&square).map(|sum| sum.angle.to_degrees().round()).collect();
        assert_eq!(angles, [45.0, 45.0, 45.0, 90.0, 30.0, 30.0, 30.0, 45.0]);
        let backwards: Vec<DVec3> = corners.into_iter().rev().collect();
        assert!(weighted_normals(&backwards).all(|sum| sum.normal.z < 0.0 && sum.angle > 0.0));
        let line = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        assert!(weighted_normals(&line).all(|sum| sum.normal == DVec3::ZERO && sum.angle == 0.0));
    }
}
