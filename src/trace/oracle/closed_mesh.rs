//! Closed meshes, and rays from inside of them that are aimed exactly at their edges and vertices: every one has to
//! hit, or there is a hole.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::DVec3;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;

use crate::scene::{Material, Polygon, Scene};
use crate::tracer::ray::{Ray, Source};

/// Vertices and origins are multiples of this, so that their differences are f32 numbers.
const GRID: f64 = 1.0 / 4096.0;

/// The largest coordinate of a mesh: as a scene with these bounds is normalised, its vertices keep their bits.
const REACH: f64 = 1.0 - GRID;

/// A closed surface of triangles.
pub struct ClosedMesh {
    pub name: &'static str,
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    inside: Inside,
}

/// Where rays start.
#[derive(Clone, Copy)]
enum Inside {
    /// Anywhere in this cube around the centre, of half this width.
    Cube(f64),
    /// Near a circle around the z axis.
    Tube { radius: f64, thickness: f64 },
}

impl ClosedMesh {
    /// All that there are.
    pub fn all() -> [Self; 3] {
        [Self::icosahedron(5), Self::torus(96, 48), Self::cube_of_fans(12)]
    }

    /// An icosahedron, its faces cut in four so many times and taken to the sphere: 20·4ⁿ triangles.
    pub fn icosahedron(subdivisions: u32) -> Self {
        let golden = 0.5 + 1.25f64.sqrt();
        let mut vertices = Vec::new();
        for axis in 0..3 {
            for (long, short) in [(golden, 1.0), (golden, -1.0), (-golden, 1.0), (-golden, -1.0)] {
                let mut vertex = DVec3::ZERO;
                (vertex[axis], vertex[(axis + 1) % 3]) = (long, short);
                vertices.push(vertex.normalize());
            }
        }
        // A face is three vertices that are neighbours of each other.
        let edge = 2.0 / (golden * golden + 1.0).sqrt();
        let are_neighbours = |a: usize, b: usize| (vertices[a].distance(vertices[b]) - edge).abs() < 0.1;
        let mut triangles = Vec::new();
        for a in 0..12 {
            for b in a + 1..12 {
                for c in b + 1..12 {
                    if are_neighbours(a, b) && are_neighbours(b, c) && are_neighbours(c, a) {
                        triangles.push([a as u32, b as u32, c as u32]);
                    }
                }
            }
        }
        for _ in 0..subdivisions {
            triangles = subdivide(&mut vertices, &triangles);
        }
        // Its corners are nearer to the centre than the faces of the undivided icosahedron, at 0.79.
        Self::new("icosahedron", vertices, triangles, Inside::Cube(0.4))
    }

    /// A torus around the z axis; both numbers are multiples of four, so that it is as wide in x as in y.
    pub fn torus(around: u32, about_tube: u32) -> Self {
        const TUBE: f64 = 0.3;
        let vertex = |i: u32| {
            let turn = TAU * f64::from(i / about_tube) / f64::from(around);
            let roll = TAU * f64::from(i % about_tube) / f64::from(about_tube);
            let radius = 1.0 - TUBE + TUBE * libm::cos(roll);
            DVec3::new(radius * libm::cos(turn), radius * libm::sin(turn), TUBE * libm::sin(roll))
        };
        let triangles = (0..around * about_tube).flat_map(|i| {
            let (ring, next_ring) = (i / about_tube, (i / about_tube + 1) % around);
            let (at, next) = (i % about_tube, (i % about_tube + 1) % about_tube);
            let [a, b, c, d] =
                [(ring, at), (next_ring, at), (next_ring, next), (ring, next)].map(|(r, a)| r * about_tube + a);
            [[a, b, c], [a, c, d]]
        });
        let vertices = (0..around * about_tube).map(vertex).collect();
        Self::new("torus", vertices, triangles.collect(), Inside::Tube { radius: 1.0 - TUBE, thickness: TUBE / 2.0 })
    }

    /// A cube each of whose faces is a fan of 4·`spokes` triangles around its centre: 48 for 12.
    pub fn cube_of_fans(spokes: u32) -> Self {
        let mut vertices = Vec::new();
        let mut triangles = Vec::new();
        for face in 0..6 {
            let side = if face < 3 { 1.0 } else { -1.0 };
            let place = |u: f64, v: f64| {
                let mut at = DVec3::ZERO;
                (at[face % 3], at[(face + 1) % 3], at[(face + 2) % 3]) = (side, u, v);
                at
            };
            let first = vertices.len() as u32;
            vertices.push(place(0.0, 0.0));
            for i in 0..4 * spokes {
                // Rounded alike on both sides of the middle: neighbouring faces run along their edge both ways.
                let along = (2.0 * f64::from(i % spokes) - f64::from(spokes)) / f64::from(spokes);
                let (u, v) = [(along, -1.0), (1.0, along), (-along, 1.0), (-1.0, -along)][(i / spokes) as usize];
                vertices.push(place(u, v));
                triangles.push([first, first + 1 + i, first + 1 + (i + 1) % (4 * spokes)]);
            }
        }
        Self::new("cube of fans", vertices, triangles, Inside::Cube(0.9))
    }

    fn new(name: &'static str, vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>, inside: Inside) -> Self {
        let largest = vertices.iter().fold(0.0, |largest: f64, v| largest.max(v.abs().max_element()));
        let vertices = vertices.iter().map(|&v| on_grid(v * (REACH / largest))).collect();
        Self { name, vertices, triangles, inside }
    }

    /// Each triangle a polygon of its own.
    pub fn scene(&self) -> Scene {
        let polygon = |i: usize| Polygon {
            first_vertex: 3 * i as u32,
            vertex_count: 3,
            first_normal: None,
            first_colour: None,
            material: 0,
        };
        Scene {
            materials: vec![Material::WHITE],
            vertices: self.triangles.iter().flatten().map(|&v| self.vertices[v as usize]).collect(),
            polygons: (0..self.triangles.len()).map(polygon).collect(),
            ..Scene::default()
        }
    }

    /// The same seed gives the same rays.
    pub fn rays(&self, seed: u64) -> impl Iterator<Item = Ray> {
        let mut random = Pcg32::seed_from_u64(seed);
        std::iter::repeat_with(move || self.ray(&mut random))
    }

    /// In turn by chance: exactly at a vertex; exactly at the middle of an edge; at a vertex or at any point of an
    /// edge, as near as a unit direction comes.
    fn ray(&self, random: &mut Pcg32) -> Ray {
        let origin = self.inside.point(random);
        let triangle = self.triangles[random.next_u32() as usize % self.triangles.len()];
        let corner = random.next_u32() as usize % 3;
        let [from, to] = [corner, (corner + 1) % 3].map(|c| self.vertices[triangle[c] as usize]);
        let direction = match random.next_u32() % 4 {
            0 => exactly(from - origin),
            1 => exactly((from + to) * 0.5 - origin),
            2 => (from - origin).normalize(),
            _ => (from.lerp(to, share(random)) - origin).normalize(),
        };
        Ray {
            origin: origin.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            t_max: f32::INFINITY,
            source: Source::Eye,
        }
    }
}

impl Inside {
    fn point(self, random: &mut Pcg32) -> DVec3 {
        let mut spread = || 2.0 * share(random) - 1.0;
        let cube = DVec3::new(spread(), spread(), spread());
        on_grid(match self {
            Self::Cube(half) => cube * half,
            Self::Tube { radius, thickness } => {
                let turn = TAU * spread();
                // In a ball, hence not the corners of a cube.
                let beside = cube / 3f64.sqrt() * thickness;
                DVec3::new(radius * libm::cos(turn), radius * libm::sin(turn), 0.0) + beside
            }
        })
    }
}

/// 0 to 1.
fn share(random: &mut Pcg32) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

fn on_grid(v: DVec3) -> DVec3 {
    (v / GRID).round() * GRID
}

/// Made about as long as a unit vector, without rounding.
fn exactly(mut direction: DVec3) -> DVec3 {
    while direction.abs().max_element() < 0.5 {
        direction *= 2.0;
    }
    if direction.abs().max_element() >= 1.0 { direction * 0.5 } else { direction }
}

/// Each triangle cut in four at the middles of its edges, which are moved out to the unit sphere.
fn subdivide(vertices: &mut Vec<DVec3>, triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut middles = BTreeMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            vertices.push((vertices[a as usize] + vertices[b as usize]).normalize());
            vertices.len() as u32 - 1
        })
    };
    let cut = |&[a, b, c]: &[u32; 3]| {
        let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
        [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    };
    triangles.iter().flat_map(cut).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::database::Section;
    use crate::database::records::Triangle;
    use crate::tracer::octree::{BuildParameters, build_database};

    /// By place, not by index: how often each edge is there.
    fn edges(mesh: &ClosedMesh) -> BTreeMap<[[i64; 3]; 2], u32> {
        let place = |v: u32| (mesh.vertices[v as usize] / GRID).to_array().map(|x| x as i64);
        let mut edges = BTreeMap::new();
        for [a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let mut ends = [place(*from), place(*to)];
                ends.sort_unstable();
                *edges.entry(ends).or_default() += 1;
            }
        }
        edges
    }

    #[test]
    fn every_edge_belongs_to_two_triangles() {
        for (mesh, triangles) in ClosedMesh::all().into_iter().zip([20 << 10, 2 * 96 * 48, 6 * 48]) {
            assert_eq!(mesh.triangles.len(), triangles, "{}", mesh.name);
            assert!(edges(&mesh).values().all(|&count| count == 2), "{}", mesh.name);
        }
    }

    #[test]
    fn vertices_and_rays_are_exact() {
        for mesh in ClosedMesh::all() {
            let database =
                build_database(&mesh.scene(), BuildParameters { leaf_size: 8, max_depth: 8 }).expect("builds");
            let normalisation = database.database().header.normalisation;
            assert_eq!((normalisation.centre, normalisation.scale), (DVec3::ZERO, 1.0), "{}", mesh.name);
            let triangles: &[Triangle] = database.unpadded().records(Section::Triangles);
            for (triangle, corners) in triangles.iter().zip(&mesh.triangles) {
                assert_eq!(triangle.vertices(), corners.map(|v| mesh.vertices[v as usize]), "{}", mesh.name);
            }
            for ray in mesh.rays(1).take(1000) {
                assert_eq!(ray.origin_f64(), on_grid(ray.origin_f64()), "{}", mesh.name);
                assert!(ray.direction_f64().abs().max_element() <= 1.0, "{}: {ray:?}", mesh.name);
            }
        }
        let long = DVec3::new(1.5, -0.25, GRID);
        assert_eq!(exactly(long), long * 0.5);
        assert_eq!(exactly(long * 0.125), long * 0.5);
    }
}
