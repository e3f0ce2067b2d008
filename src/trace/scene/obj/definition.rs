//! What an MTL library says of one material, and what it means here.

use glam::DVec3;

use crate::scene::Material;
use crate::scene::cursor::Field;

/// A material as its statements have it. Numbers that may be warned of are beside the place of their statement.
#[derive(Clone, Copy, Default, Debug)]
pub(super) struct Definition {
    /// Kd.
    pub(super) diffuse: Option<DVec3>,
    /// Ks.
    pub(super) specular: DVec3,
    /// Ke.
    pub(super) emission: DVec3,
    /// Ns; 0 is no highlight.
    pub(super) shine: f64,
    /// Ni, any number.
    pub(super) ior: Option<(usize, f64)>,
    /// d, opacity from 0 to 1.
    pub(super) dissolve: Option<f64>,
    /// Tr, from 0 to 1.
    pub(super) transparency: Option<(usize, f64)>,
    /// illum, from 0 to 10.
    pub(super) model: Option<(usize, u8)>,
}

impl Definition {
    /// The illumination model of a material without one.
    pub(super) const MODEL: u8 = 2;
    pub(super) const IOR: Field = Field { name: "Ni", min: 1e-3, max: 1e6 };

    /// Illumination models 0 and 1 have no highlight, 2 has one, those above reflect as well. 6 and 7 refract; with
    /// all others a surface that is not opaque is a sheet that dissolves: all of it fades, and nothing is bent.
    ///
    /// `warn` gets what is repaired: kind, place, and text.
    pub(super) fn material(&self, mut warn: impl FnMut(&'static str, usize, &'static str)) -> Material {
        let (at, model) = self.model.unwrap_or((0, Self::MODEL));
        let opacity = self.opacity(&mut warn);
        let transmittance = 1.0 - opacity;
        let refracts = matches!(model, 6 | 7);
        // Of what the surface itself sends to the eye.
        let sheet = if refracts { 1.0 } else { opacity };
        Material {
            diffuse: self.diffuse.unwrap_or(Material::WHITE.diffuse) * opacity,
            highlight: if model >= 2 && self.shine > 0.0 { self.specular * sheet } else { DVec3::ZERO },
            reflection: if model >= 3 { self.specular * sheet } else { DVec3::ZERO },
            shine: self.shine,
            transmittance,
            ior: if refracts && transmittance > 0.0 { self.refractive_index(at, &mut warn) } else { 1.0 },
            emission: self.emission * sheet,
            shadow_transmittance: transmittance,
        }
    }

    fn opacity(&self, warn: &mut impl FnMut(&'static str, usize, &'static str)) -> f64 {
        const TOLERANCE: f64 = 1e-4;
        match (self.dissolve, self.transparency) {
            (Some(dissolve), Some((at, transparency))) => {
                if (dissolve - (1.0 - transparency)).abs() > TOLERANCE {
                    warn("opacity-twice", at, "Tr is not 1 - d of its material, expected that: d is used");
                }
                dissolve
            }
            (Some(dissolve), None) => dissolve,
            (None, Some((at, 1.0))) => {
                let what =
                    "Tr 1 without d is fully transparent in some files and opaque in others: it is read as opaque";
                warn("opaque-or-transparent", at, what);
                1.0
            }
            (None, Some((_, transparency))) => 1.0 - transparency,
            (None, None) => 1.0,
        }
    }

    /// `model_at` is the place of the statement that asks for refraction.
    fn refractive_index(&self, model_at: usize, warn: &mut impl FnMut(&'static str, usize, &'static str)) -> f64 {
        match self.ior {
            Some((_, ior)) if (Self::IOR.min..=Self::IOR.max).contains(&ior) => ior,
            Some((at, _)) => {
                warn(
                    "refractive-index",
                    at,
                    "Ni is out of range, expected an index of refraction from 0.001 to 1e6: 1 is used",
                );
                1.0
            }
            None => {
                warn(
                    "refractive-index",
                    model_at,
                    "illum of refraction without Ni, expected an index of refraction: 1 is used",
                );
                1.0
            }
        }
    }
}
