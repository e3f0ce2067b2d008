//! `marti-master`: one cluster's job queue. Started by `marti run`.

use marti::ids::ClusterId;
use marti::processes::{Child, master};
use marti::protocol::hello::Role;

fn main() -> anyhow::Result<()> {
    let child = Child::start("marti-master", Role::Master(ClusterId(0)))?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(master::run(child)).inspect_err(|error| tracing::error!("{error}"))?;
    Ok(())
}
