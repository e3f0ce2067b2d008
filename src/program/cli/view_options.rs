//! Options that say what is seen, and from where.

use std::str::FromStr;

use clap::Args;

use cluster::topology::value::{Angle, Channel, Coordinate};
use trace::picture::Terminator;
use trace::preparation::{CameraChoices, ViewChoices};
use trace::scene::{Light, UpAxis};

/// What is seen, and from where.
#[derive(Clone, Debug, Args)]
pub(super) struct ViewOptions {
    /// The eye, world units [default: the scene's, else where all of the scene is seen from]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    camera_from: Option<Point>,
    /// The point in the middle of the image [default: the scene's, else the middle of the scene]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    camera_at: Option<Point>,
    /// The direction that is up in the image [default: the scene's, else the axis of --up]
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    camera_up: Option<Point>,
    /// Full vertical field of view, degrees [default: the scene's, else 45]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    camera_angle: Option<Angle>,
    /// A point light and its linear colour, white if it is left out; give it once per light: they replace all lights of the scene
    #[arg(long, value_name = "X,Y,Z[,R,G,B]", allow_hyphen_values = true)]
    light: Vec<PointLight>,
    /// Linear colour where a ray hits nothing [default: the scene's]
    #[arg(long, value_name = "R,G,B", allow_hyphen_values = true)]
    background: Option<Colour>,
    /// The vertical axis of a scene without a camera [default: y]
    #[arg(long, value_name = "y|z")]
    up: Option<UpAxis>,
    /// Where smooth surfaces turn away from a light: as their triangles do, or as if they were round [default: as is usual
    /// for the scene's kind of file]
    #[arg(long, value_name = "hard|soft")]
    pub(super) terminator: Option<Terminator>,
}

impl ViewOptions {
    pub(super) fn choices(&self) -> ViewChoices {
        let point = |point: Option<Point>| point.map(|Point(point)| point.into());
        ViewChoices {
            camera: CameraChoices {
                from: point(self.camera_from),
                at: point(self.camera_at),
                up: point(self.camera_up),
                angle_degrees: self.camera_angle.map(|angle| angle.0),
            },
            lights: self.light.iter().map(|&PointLight(light)| light).collect(),
            background: self.background.map(|Colour(colour)| colour.into()),
            up: self.up,
        }
    }
}

/// World units.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point([f64; 3]);

/// Linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Colour([f64; 3]);

#[derive(Clone, Copy, Debug, PartialEq)]
struct PointLight(Light);

impl FromStr for Point {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match coordinates(&text.split(',').collect::<Vec<_>>())? {
            Some(point) => Ok(Self(point)),
            None => Err("expected three numbers such as 1,-2.5,0".to_owned()),
        }
    }
}

impl FromStr for Colour {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match channels(&text.split(',').collect::<Vec<_>>())? {
            Some(colour) => Ok(Self(colour)),
            None => Err("expected red, green and blue such as 0.1,0.2,1".to_owned()),
        }
    }
}

impl FromStr for PointLight {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<_> = text.split(',').collect();
        let (position, colour) = parts.split_at(parts.len().min(3));
        let colour = if colour.is_empty() { Some([1.0; 3]) } else { channels(colour)? };
        match (coordinates(position)?, colour) {
            (Some(position), Some(colour)) => Ok(Self(Light { position: position.into(), colour: colour.into() })),
            _ => Err("expected a position, or a position and a colour, such as 5,9,3 or 5,9,3,1,0.9,0.8".to_owned()),
        }
    }
}

/// `None` unless there are three.
fn coordinates(parts: &[&str]) -> Result<Option<[f64; 3]>, String> {
    three(parts, |part| part.parse().map(|Coordinate(x)| x))
}

/// `None` unless there are three.
fn channels(parts: &[&str]) -> Result<Option<[f64; 3]>, String> {
    three(parts, |part| part.parse().map(|Channel(x)| x))
}

fn three(parts: &[&str], number: impl Fn(&str) -> Result<f64, String>) -> Result<Option<[f64; 3]>, String> {
    let number = |part: &str| number(part.trim()).map_err(|expected| format!("`{part}`: {expected}"));
    match parts {
        [x, y, z] => Ok(Some([number(x)?, number(y)?, number(z)?])),
        _ => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Options {
        #[command(flatten)]
        view: ViewOptions,
    }

    fn choices(arguments: &[&str]) -> Result<ViewChoices, String> {
        let line = ["x"].into_iter().chain(arguments.iter().copied());
        Options::try_parse_from(line).map(|options| options.view.choices()).map_err(|error| error.to_string())
    }

    #[test]
    fn what_is_given_is_chosen() {
        assert_eq!(choices(&[]), Ok(ViewChoices::default()));
        let line = ["--camera-from", "-1,2, 3e2", "--camera-angle", "30", "--light", "-5,9,3", "--light=0,0,1,0,0.5,2"];
        let found = choices(&line).expect("all are possible");
        assert_eq!(found.camera.from, Some([-1.0, 2.0, 300.0].into()));
        assert_eq!((found.camera.at, found.camera.up, found.camera.angle_degrees), (None, None, Some(30.0)));
        let lights = [
            Light { position: [-5.0, 9.0, 3.0].into(), colour: [1.0; 3].into() },
            Light { position: [0.0, 0.0, 1.0].into(), colour: [0.0, 0.5, 2.0].into() },
        ];
        assert_eq!(found.lights, lights);
        let found = choices(&["--background", "0,0.5,1", "--up", "z"]).expect("both are possible");
        assert_eq!((found.background, found.up), (Some([0.0, 0.5, 1.0].into()), Some(UpAxis::Z)));
    }

    #[test]
    fn what_cannot_be_is_refused_with_what_was_expected() {
        for (line, expected) in [
            (["--camera-from", "1,2"], "expected three numbers such as 1,-2.5,0"),
            (["--camera-at", "1,2,nan"], "`nan`: expected a number from -1e12 to 1e12"),
            (["--camera-up", "1,2,3,4"], "expected three numbers"),
            (["--camera-angle", "180"], "expected a number from 0.001 to 179.9"),
            (["--light", "1,2,3,4"], "expected a position, or a position and a colour"),
            (["--light", "1,2,3,1,1,-1"], "`-1`: expected a number from 0 to 1000000"),
            (["--background", "red"], "expected red, green and blue"),
            (["--up", "x"], "expected y or z"),
            (["--terminator", "medium"], "expected hard or soft"),
        ] {
            let error = choices(&line).expect_err(expected);
            assert!(error.contains(expected), "{line:?}: {error}");
        }
    }
}
