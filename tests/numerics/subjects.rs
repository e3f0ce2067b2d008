//! Small databases in the root's own coordinates, and what every kernel finds in them.

use glam::DVec3;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use trace::database::compile::compile;
use trace::database::records::{Cone, Sphere, Surface, Triangle};
use trace::database::verify::Verified;
use trace::oracle::{BruteForce, Subject, Verdict};
use trace::scene::{Material, Scene};
use trace::tracer::hit::Hit;
use trace::tracer::octree::{BuildParameters, build};
use trace::tracer::ray::{Ray, Source};

pub(crate) type Vector = [f32; 3];

/// From a single leaf to cells smaller than their padding.
pub(crate) const TREES: [BuildParameters; 4] = [
    BuildParameters { leaf_size: 1, max_depth: 0 },
    BuildParameters { leaf_size: 1, max_depth: 5 },
    BuildParameters { leaf_size: 4, max_depth: 12 },
    BuildParameters { leaf_size: 1, max_depth: 20 },
];

/// Primitives whose numbers are taken as they are.
#[derive(Clone, Debug, Default)]
pub(crate) struct Pieces {
    pub(crate) triangles: Vec<Triangle>,
    pub(crate) spheres: Vec<Sphere>,
    pub(crate) cones: Vec<Cone>,
}

impl Pieces {
    /// Each a polygon of its own.
    pub(crate) fn of_triangles(triangles: impl IntoIterator<Item = [Vector; 3]>) -> Self {
        let mut pieces = Self::default();
        triangles.into_iter().for_each(|vertices| pieces.add(vertices));
        pieces
    }

    pub(crate) fn add(&mut self, vertices: [Vector; 3]) {
        self.triangles.push(Triangle::new(vertices, self.triangles.len() as u32, 0));
    }

    /// Two triangles, the corners in order.
    pub(crate) fn add_quad(&mut self, [a, b, c, d]: [Vector; 4]) {
        self.add([a, b, c]);
        self.add([a, c, d]);
    }

    pub(crate) fn database(&self, parameters: BuildParameters) -> Verified {
        let scene = Scene { materials: vec![Material::WHITE], ..Scene::default() };
        let mut records = compile(&scene).expect("nothing to compile");
        (records.triangles, records.spheres) = (self.triangles.clone(), self.spheres.clone());
        records.cones = self.cones.clone();
        records.surfaces = vec![Surface::plain(0); records.primitive_count()];
        let octree = build::build(&records, parameters);
        let database = records.assemble(octree.words, octree.leaf_lists, parameters.max_depth).expect("small");
        Verified::new(database).expect("sound")
    }

    /// What the rays hit, as [`hits_of`] for each of [`TREES`]; all give the same bits.
    pub(crate) fn hits(&self, rays: &[Ray]) -> Vec<Option<Hit>> {
        let mut found: Option<Vec<Option<Hit>>> = None;
        for tree in TREES {
            let hits = hits_of(&self.database(tree), rays);
            if let Some(first) = &found {
                for ((ray, hit), first) in rays.iter().zip(&hits).zip(first) {
                    assert_eq!(bits(hit), bits(first), "{tree:?}, {ray:?}");
                }
            }
            found.get_or_insert(hits);
        }
        found.expect("there are trees")
    }

    /// What one ray hits.
    pub(crate) fn hit(&self, ray: Ray) -> Option<(f32, u32)> {
        self.hits(&[ray])[0].map(|hit| (hit.t, hit.primitive.0))
    }
}

/// What the rays hit. No kernel may lose a hit, or find one that is not there, or give other bits than HERO; and
/// each has to say that there is something just where there is a nearest hit.
pub(crate) fn hits_of(database: &Verified, rays: &[Ray]) -> Vec<Option<Hit>> {
    let subject = Subject::new(database);
    let oracle = BruteForce::new(database);
    let mut found: Option<Vec<Option<Hit>>> = None;
    for mut tracer in subject.tracers() {
        let kernel = tracer.kernel();
        let hits = tracer.nearest(rays);
        let occluded = tracer.occluded(rays);
        assert_eq!((hits.len(), occluded.len()), (rays.len(), rays.len()), "{kernel}");
        for (i, ray) in rays.iter().enumerate() {
            let hit = &hits[i];
            assert_eq!(occluded[i], hit.is_some(), "{kernel}, shadow ray {i}, {ray:?}");
            match &found {
                Some(hero) => assert_eq!(bits(hit), bits(&hero[i]), "{kernel}, ray {i}, {ray:?}"),
                None => {
                    let answer = oracle.nearest(ray);
                    let verdict = answer.judge(hit.as_ref());
                    let right = matches!(verdict, Verdict::Agrees { .. } | Verdict::OtherPrimitive { .. });
                    assert!(right, "{kernel}, ray {i}: {verdict:?}, {:?} for {answer:?}, {ray:?}", bits(hit));
                }
            }
        }
        found.get_or_insert(hits);
    }
    found.expect("there are kernels")
}

/// What two hits have to share.
pub(crate) fn bits(hit: &Option<Hit>) -> Option<(u32, u32)> {
    hit.map(|hit| (hit.t.to_bits(), hit.primitive.0))
}

pub(crate) fn ray(origin: Vector, direction: Vector) -> Ray {
    Ray { origin, direction, t_max: f32::INFINITY, source: Source::Eye }
}

/// From one point towards another one, without rounding where their difference has few bits.
pub(crate) fn towards(origin: DVec3, target: DVec3) -> Ray {
    let mut direction = target - origin;
    while direction.abs().max_element() < 0.5 && direction != DVec3::ZERO {
        direction *= 2.0;
    }
    if direction.abs().max_element() >= 1.0 {
        direction *= 0.5;
    }
    ray(f32s(origin), f32s(direction))
}

pub(crate) fn f32s(v: DVec3) -> Vector {
    v.as_vec3().to_array()
}

/// The same seed gives the same numbers.
pub(crate) struct Chance(Pcg32);

impl Chance {
    pub(crate) fn new(seed: u64) -> Self {
        Self(Pcg32::seed_from_u64(seed))
    }

    /// −1 to 1.
    pub(crate) fn unit(&mut self) -> f64 {
        f64::from(self.0.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    pub(crate) fn below(&mut self, end: u32) -> u32 {
        self.0.next_u32() % end
    }

    /// Anywhere in the root.
    pub(crate) fn point(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// In the root, and a multiple of 1/1024: differences of such points are f32 numbers.
    pub(crate) fn grid_point(&mut self) -> DVec3 {
        (self.point() * 1024.0).round() / 1024.0
    }

    pub(crate) fn direction(&mut self) -> DVec3 {
        loop {
            let point = self.point();
            if (0.01..1.0).contains(&point.length()) {
                return point.normalize();
            }
        }
    }

    /// Triangles of many sizes, every fourth in a plane that divides cells, and some spheres and cones.
    pub(crate) fn soup(&mut self, count: usize) -> Pieces {
        let mut pieces = Pieces::default();
        for i in 0..count {
            let size = 10f64.powf(self.unit() * 1.5 - 1.0);
            let at = self.point();
            let vertices = [0; 3].map(|_| {
                let mut vertex = (at + self.point() * size).clamp(DVec3::NEG_ONE, DVec3::ONE);
                if i % 4 == 0 {
                    vertex[i % 3] = 0.125 * (i % 16) as f64 - 1.0;
                }
                f32s(vertex)
            });
            pieces.add(vertices);
            if i % 8 == 0 {
                let radius = (self.unit() * 0.3) as f32;
                pieces.spheres.push(Sphere { centre: f32s(self.point() * 0.7), radius });
                pieces.cones.push(Cone {
                    base: f32s(self.point() * 0.7),
                    base_radius: 0.1 + radius.abs() / 2.0,
                    apex: f32s(self.point() * 0.7),
                    apex_radius: (self.unit().abs() * 0.2) as f32,
                });
            }
        }
        pieces
    }
}
