//! A scene as an NFF file with the numbers that SPD would print.

use std::fmt;
use std::io::{self, Write};

use glam::DVec3;

use crate::scene::{Camera, Light, Material, Scene};

/// Marti has no front clipping plane; others that read the file get one that clips nothing of SPD's scenes.
const HITHER: f64 = 0.01;

/// Writes a scene as NFF, six digits a number: polygons, then spheres, then cones, and `f` before each
/// that has another material than the one before.
///
/// NFF has one Ks, which is written as the strongest component of highlight and reflection, and no way to
/// tell a surface's colour from Kd, so that Kd is chosen.
///
/// # Errors
/// Those of `out`.
pub fn write_nff(scene: &Scene, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "b {}", Triple(scene.background))?;
    if let Some(camera) = &scene.camera {
        write_view(camera, out)?;
    }
    write_lights(&scene.lights, out)?;
    let mut current = None;
    let mut set_material = |index: u32, out: &mut _| {
        if current.replace(index) == Some(index) {
            Ok(())
        } else {
            write_material(&scene.materials[index as usize], out)
        }
    };
    for polygon in &scene.polygons {
        set_material(polygon.material, out)?;
        let corners = scene.corners(polygon);
        match scene.corner_normals(polygon) {
            None => {
                writeln!(out, "p {}", corners.len())?;
                corners.iter().try_for_each(|&corner| writeln!(out, "{}", Triple(corner)))?;
            }
            Some(normals) => {
                writeln!(out, "pp {}", corners.len())?;
                let mut both = corners.iter().zip(normals);
                both.try_for_each(|(&corner, &normal)| writeln!(out, "{} {}", Triple(corner), Triple(normal)))?;
            }
        }
    }
    for sphere in &scene.spheres {
        set_material(sphere.material, out)?;
        writeln!(out, "s {} {}", Triple(sphere.centre), Number(sphere.radius))?;
    }
    for cone in &scene.cones {
        set_material(cone.material, out)?;
        writeln!(out, "c")?;
        writeln!(out, "{} {}", Triple(cone.base), Number(cone.base_radius))?;
        writeln!(out, "{} {}", Triple(cone.apex), Number(cone.apex_radius))?;
    }
    Ok(())
}

fn write_view(camera: &Camera, out: &mut impl Write) -> io::Result<()> {
    let (width, height) = camera.resolution.unwrap_or((512, 512));
    writeln!(out, "v")?;
    writeln!(out, "from {}", Triple(camera.from))?;
    writeln!(out, "at {}", Triple(camera.at))?;
    writeln!(out, "up {}", Triple(camera.up))?;
    writeln!(out, "angle {}", Number(camera.angle_degrees))?;
    writeln!(out, "hither {}", Number(HITHER))?;
    writeln!(out, "resolution {width} {height}")
}

/// With their colours, unless all have the brightness that NFF gives to lights without one.
fn write_lights(lights: &[Light], out: &mut impl Write) -> io::Result<()> {
    let plain = DVec3::splat(1.0 / (lights.len() as f64).sqrt());
    let are_plain = lights.iter().all(|light| light.colour == plain);
    lights.iter().try_for_each(|light| match are_plain {
        true => writeln!(out, "l {}", Triple(light.position)),
        false => writeln!(out, "l {} {}", Triple(light.position), Triple(light.colour)),
    })
}

fn write_material(material: &Material, out: &mut impl Write) -> io::Result<()> {
    let strongest = material.diffuse.max_element();
    let ks = material.highlight.max(material.reflection).max_element();
    // A colour is brought to a strongest component of 1. Of a grey Kd takes what Ks and T leave, as long
    // as that holds it: so SPD's own greys come out as they went in.
    let rest = 1.0 - ks - material.transmittance;
    let is_grey = material.diffuse == DVec3::splat(strongest);
    let kd = if is_grey && rest >= strongest { rest } else { strongest };
    let colour = if kd > 0.0 { material.diffuse / kd } else { DVec3::ZERO };
    let (kd, ks, shine) = (Number(kd), Number(ks), Number(material.shine));
    writeln!(out, "f {} {kd} {ks} {shine} {} {}", Triple(colour), Number(material.transmittance), Number(material.ior))
}

/// Three numbers with blanks between them.
struct Triple(DVec3);

impl fmt::Display for Triple {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {}", Number(self.0.x), Number(self.0.y), Number(self.0.z))
    }
}

/// A number as C's `%g` prints it: six digits at the most, no zeros at the end, an exponent when it is
/// below −4 or above 5.
struct Number(f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const DIGITS: usize = 6;
        let scientific = format!("{:.*e}", DIGITS - 1, self.0.abs());
        let (digits, exponent) = scientific.split_once('e').ok_or(fmt::Error)?;
        let exponent: i32 = exponent.parse().map_err(|_| fmt::Error)?;
        let (first, rest) = digits.split_once('.').ok_or(fmt::Error)?;
        let rest = rest.trim_end_matches('0');
        let point = if rest.is_empty() { "" } else { "." };
        if self.0.is_sign_negative() {
            f.write_str("-")?;
        }
        match exponent {
            0 => write!(f, "{first}{point}{rest}"),
            1..6 => {
                let whole = exponent as usize;
                let (whole, fraction) = (&rest[..rest.len().min(whole)], rest.get(whole..).unwrap_or_default());
                let point = if fraction.is_empty() { "" } else { "." };
                write!(f, "{first}{whole:0<width$}{point}{fraction}", width = exponent as usize)
            }
            -4..0 => write!(f, "0.{:0<width$}{first}{rest}", "", width = (-1 - exponent) as usize),
            _ => {
                let sign = if exponent < 0 { '-' } else { '+' };
                write!(f, "{first}{point}{rest}e{sign}{:02}", exponent.abs())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::procedural::tests::{REFERENCES, reference};
    use crate::scene::procedural::{Board, Procedural};
    use crate::scene::{Cone, Sphere};

    #[test]
    fn numbers_are_printed_as_c_prints_them() {
        for (number, expected) in [
            (0.0, "0"),
            (-0.0, "-0"),
            (1.0, "1"),
            (-12.0, "-12"),
            (100_000.0, "100000"),
            (999_999.5, "1e+06"),
            (1_234_567.0, "1.23457e+06"),
            (0.5, "0.5"),
            (2.0 / 3.0, "0.666667"),
            (0.0001, "0.0001"),
            (0.000_099_999_96, "0.0001"),
            (0.000_01, "1e-05"),
            (-2.220_45e-16, "-2.22045e-16"),
            (1e-300, "1e-300"),
            (0.017_986_43, "0.0179864"),
            (123.456_789, "123.457"),
        ] {
            assert_eq!(Number(number).to_string(), expected);
        }
    }

    /// Line by line: the same words, and numbers that are the same to 1e-5. Only the front clipping plane
    /// differs.
    #[test]
    fn files_are_those_that_spd_writes() {
        for (kind, size, name) in REFERENCES {
            let Some(path) = reference(name) else { return };
            let theirs = std::fs::read_to_string(path).expect("a reference scene");
            let mut ours = Vec::new();
            write_nff(&Procedural { kind, size, board: Board::Squares }.scene(), &mut ours).expect("memory");
            let ours = String::from_utf8(ours).expect("text");
            assert_eq!(ours.lines().count(), theirs.lines().count());
            let lines = ours.lines().zip(theirs.lines()).enumerate();
            for (line, (ours, theirs)) in lines.filter(|(_, (ours, _))| !ours.starts_with("hither")) {
                assert_eq!(ours.split(' ').count(), theirs.split(' ').count(), "{name}:{}: {ours}", line + 1);
                for (a, b) in ours.split(' ').zip(theirs.split(' ')) {
                    let numbers = a.parse::<f64>().ok().zip(b.parse::<f64>().ok());
                    let is_close = numbers.is_some_and(|(a, b)| (a - b).abs() <= 1e-5 * b.abs().max(1.0));
                    assert!(a == b || is_close, "{name}:{}: {ours}, SPD writes {theirs}", line + 1);
                }
            }
        }
    }

    #[test]
    fn every_kind_of_primitive_and_light_is_written() {
        let colour = DVec3::new(1.0, 0.5, 0.25);
        let scene = Scene {
            lights: vec![Light { position: DVec3::X, colour }],
            materials: vec![Material::from_nff(colour, 0.5, 0.25, 10.0, 0.125, 1.5)],
            spheres: vec![Sphere { centre: DVec3::ZERO, radius: -1.0, material: 0 }],
            cones: vec![Cone { base: DVec3::ZERO, base_radius: 1.0, apex: DVec3::Z, apex_radius: 0.0, material: 0 }],
            ..Scene::default()
        };
        let mut text = Vec::new();
        write_nff(&scene, &mut text).expect("memory");
        let expected =
            "b 0 0 0\nl 1 0 0 1 0.5 0.25\nf 1 0.5 0.25 0.5 0.25 10 0.125 1.5\ns 0 0 0 -1\nc\n0 0 0 1\n0 0 1 0\n";
        assert_eq!(String::from_utf8_lossy(&text), expected);
    }
}
