//! A whole cluster in one process and in virtual time: manager, master, two nodes, bus and display render the teapot through
//! local memories of an eighth of the database, and the image is the renderer's, to the bit:
//! `cargo run --release --features testing --example cluster`.

use std::error::Error;

use marti::simulation::Cluster;
use marti::{ImageSettings, Octree, Renderer, SceneSource, ViewChoices, build_database, view};

fn main() -> Result<(), Box<dyn Error>> {
    let scene = "teapot:6".parse::<SceneSource>()?.load()?;
    let settings = ImageSettings::new(128, 128, ImageSettings::DEPTH_DEFAULT, 0.0)?;
    let view = view(&scene, &ViewChoices::default(), |_| Ok(settings))?;
    let database = build_database(&scene, Octree::DEFAULT.into())?;

    let cluster = Cluster { nodes: 2, local_memory: "1/8".parse()?, tile: 16, seed: 1 };
    let rendered = cluster.render(&database, &view)?;
    println!("{:<6}{:>8}{:>12}{:>12}", "node", "tiles", "hits", "misses");
    for node in &rendered.nodes {
        let memory = node.memory.as_ref().ok_or("every node has a local memory")?;
        println!("{:<6}{:>8}{:>12}{:>12}", node.id, node.tiles, memory.hits, memory.misses);
    }
    let bus = rendered.bus.ok_or("the bus has closed its books")?;
    println!("{} fetches, {} bytes over the bus", bus.fetches, bus.bytes);
    println!("{:.1} s of virtual time", rendered.took.as_secs_f64());

    let expected = Renderer::new(&database).render(&view)?.frame.sha256();
    let sha256 = rendered.frame.sha256();
    println!("sha256 {sha256}");
    if sha256 == expected { Ok(()) } else { Err(format!("the renderer's image has sha256 {expected}").into()) }
}
