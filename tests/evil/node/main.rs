//! `marti` with the hostile node of the tests: `marti` in every respect, unless it is `marti node`, its bootstrap says that it is node
//! MARTI_EVIL_NODE (0 if unset) and MARTI_EVIL names a [`Mode`].

mod bus;
mod completions;
mod connections;
mod ground;
mod impostors;
mod messages;
mod mode;
mod node;
mod opening;
mod pixels;
mod reports;
mod unasked;

use std::env;
use std::error::Error;
use std::process::ExitCode;

use ::ground::ids::NodeId;
use clap::{Parser, ValueEnum};
use cluster::processes::{Child, node as true_node};
use cluster::protocol::hello::Role;
use program::cli::entry::{self, JoinArguments};

use self::ground::Ground;
use self::mode::Mode;
use self::node::Node;
use self::opening::Then;

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

/// A processing node that cannot be trusted.
#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    join: JoinArguments,
}

fn main() -> ExitCode {
    let mut arguments = env::args_os().peekable();
    let program = arguments.next();
    if arguments.next_if(|role| role == "node").is_none() {
        return entry::enter(|| entry::parse::<program::cli::Arguments>(env!("CARGO_PKG_VERSION")).carry_out());
    }
    let Arguments { join } = Arguments::parse_from(program.into_iter().chain(arguments));
    join.play("marti-node", Role::Node(NodeId(0)), run)
}

fn run(child: &Child) -> Outcome {
    match mode(child.bootstrap.role)? {
        None => Ok(true_node::run(child, None)?),
        Some(mode) => {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            runtime.block_on(live(child, mode)).inspect_err(|error| tracing::error!("{error}"))
        }
    }
}

/// `None`: this process is honest.
fn mode(role: Role) -> Outcome<Option<Mode>> {
    let Ok(mode) = env::var("MARTI_EVIL") else { return Ok(None) };
    let node = env::var("MARTI_EVIL_NODE").unwrap_or_else(|_| "0".to_owned()).parse()?;
    if role != Role::Node(NodeId(node)) {
        return Ok(None);
    }
    Ok(Some(Mode::from_str(&mode, false).map_err(|_| format!("MARTI_EVIL: there is no mode {mode}"))?))
}

/// What it does, for the tests: that it was done is to be seen in this process's log.
fn deed(what: impl std::fmt::Display) {
    tracing::warn!("evil: {what}");
}

async fn live(child: &Child, mode: Mode) -> Outcome {
    if mode == Mode::ForeignControl {
        return reports::foreign(child).await;
    }
    let Some(mut ground) = Ground::reach(child, mode).await? else { return Ok(()) };
    let outcome = match opening::act(&mut ground).await {
        Ok(Then::Work) => match Node::start(&mut ground).await {
            Ok(mut node) => node.work(&mut ground).await,
            Err(error) => Err(error),
        },
        Ok(Then::Idle) => ground.idle().await,
        Ok(Then::End) => {
            ground.link.close();
            return Ok(());
        }
        Err(error) => Err(error),
    };
    ground.leave(&outcome).await;
    outcome
}
