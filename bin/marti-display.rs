//! `marti-display`: the frame buffer and the image files. Started by `marti run`.

use marti::processes::{Child, display};
use marti::protocol::hello::Role;

fn main() -> anyhow::Result<()> {
    let child = Child::start("marti-display", Role::Display)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(display::run(child)).inspect_err(|error| tracing::error!("{error}"))?;
    Ok(())
}
