//! Renders a scene to a PNG file: `cargo run --release --example render -- teapot:12 teapot.png`.

use std::error::Error;
use std::path::Path;

use marti::{ImageDefaults, ImageSettings, Octree, Renderer, SceneSource, ViewChoices, build_database, view};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, image] = &arguments[..] else { return Err("expected a scene and the image's name".into()) };
    let scene = scene.parse::<SceneSource>()?.load()?;
    let settings = ImageSettings::new(256, 256, ImageSettings::DEPTH_DEFAULT, 0.0)?;
    // The terminator is what is usual for the kind of file; width, height, depth and cutoff are ours.
    let image_settings = |defaults: &ImageDefaults| Ok(settings.with_terminator(defaults.terminator));
    let view = view(&scene, &ViewChoices::default(), image_settings)?;
    let database = build_database(&scene, Octree::DEFAULT.into())?;
    let rendering = Renderer::new(&database).render(&view)?;
    rendering.frame.write(Path::new(image), false)?;
    println!("{} rays, sha256 {}", rendering.stats.all_rays(), rendering.frame.sha256());
    Ok(())
}
