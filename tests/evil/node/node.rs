//! A node at work: what its conversations bring, and what it says in them.

use std::collections::HashMap;

use cluster::processes::node::tiles::{Job, Traced};
use cluster::processes::node::tracer_thread::{FromTracer, Tracer};
use cluster::protocol::connection::{Receiver, Sender};
use cluster::protocol::control::{NodeCommand, NodeReport};
use cluster::protocol::hello::Role;
use cluster::protocol::image::{ImageReply, TilePixels};
use cluster::protocol::mac::Mac;
use cluster::protocol::work::{TileDone, WorkReply, WorkRequest, jobs_per_node};
use ground::ids::{Attempt, TileId};

use tokio::time::Instant;

use super::Outcome;
use super::deed;
use super::ground::Ground;
use super::mode::Mode;

pub(crate) struct Node {
    to_master: Sender<WorkRequest>,
    from_master: Receiver<WorkReply>,
    to_display: Sender<TilePixels>,
    from_display: Receiver<ImageReply>,
    pub(crate) tracer: Tracer,
    /// Traced, and not reported done.
    pub(crate) traced: Vec<Traced>,
    /// Traced, and kept from the display.
    pub(crate) withheld: Vec<Traced>,
    /// Tiles traced so far.
    pub(crate) count: u32,
    /// Whether it has reported a tile done, where it reports one only.
    pub(crate) has_told: bool,
    /// When each tile came that it has.
    pub(crate) since: HashMap<TileId, Instant>,
}

pub(crate) enum Event {
    TracerReady,
    Job(Job),
    Traced(Traced),
    Acknowledged(TileId, Attempt, Mac),
    NewDisplay,
    Finish,
}

impl Node {
    pub(crate) async fn start(ground: &mut Ground) -> Outcome<Self> {
        let (to_master, from_master) = ground.talk(ground.master()).await?;
        let (to_display, from_display) = ground.talk(Role::Display).await?;
        let tracer =
            Tracer::start(ground.configuration.clone(), None, ground.introduction.clone(), ground.pulse.clone())?;
        Ok(Self {
            to_master,
            from_master,
            to_display,
            from_display,
            tracer,
            traced: Vec::new(),
            withheld: Vec::new(),
            count: 0,
            has_told: false,
            since: HashMap::new(),
        })
    }

    /// Until it is asked to finish.
    pub(crate) async fn work(&mut self, ground: &mut Ground) -> Outcome {
        loop {
            match self.event(ground).await? {
                Event::Finish if ground.mode == Mode::NoFinish => {
                    deed("does not finish");
                    std::future::pending::<()>().await;
                }
                Event::Finish => return Ok(()),
                Event::NewDisplay => {
                    (self.to_display, self.from_display) = ground.talk(Role::Display).await?;
                    for traced in self.traced.clone() {
                        self.send_tile(&traced).await?;
                    }
                }
                Event::TracerReady => {
                    for _ in 0..jobs_per_node(1) {
                        self.ask().await?;
                    }
                }
                Event::Job(job) => self.take(ground.mode, job)?,
                Event::Traced(traced) => self.hand_over(ground, traced).await?,
                Event::Acknowledged(tile, attempt, receipt) => {
                    self.acknowledged(ground.mode, (tile, attempt), receipt).await?;
                }
            }
        }
    }

    async fn event(&mut self, ground: &mut Ground) -> Outcome<Event> {
        loop {
            tokio::select! {
                command = ground.link.commands.recv() => match command {
                    Some(NodeCommand::Finish) => return Ok(Event::Finish),
                    Some(NodeCommand::Display(address)) => {
                        ground.configuration.display = address;
                        return Ok(Event::NewDisplay);
                    }
                    Some(_) => {}
                    None => return Err("the manager is gone".into()),
                },
                said = self.tracer.said.recv() => match said {
                    Some(FromTracer::Ready(packets)) => {
                        if let Some(packets) = packets {
                            ground.link.reports.send(NodeReport::Packets(packets)).await?;
                        }
                        return Ok(Event::TracerReady);
                    }
                    Some(FromTracer::Traced(traced)) => return Ok(Event::Traced(traced)),
                    Some(FromTracer::Failed(why)) => return Err(why.into()),
                    None => return Err("the tracer's thread ended".into()),
                },
                reply = self.from_master.receive() => match reply? {
                    Some(WorkReply::Job { tile, attempt, permit }) => {
                        let rect = ground.configuration.tiling.rect(tile).ok_or("there is no such tile")?;
                        return Ok(Event::Job(Job { tile, attempt, rect, permit }));
                    }
                    None => return Err("the master closed the connection".into()),
                },
                reply = self.from_display.receive() => match reply? {
                    Some(ImageReply::Acknowledged { tile, attempt, receipt }) => {
                        return Ok(Event::Acknowledged(tile, attempt, receipt));
                    }
                    Some(ImageReply::Refused(why)) => return Err(format!("the display refused a tile: {why}").into()),
                    None => return Err("the display closed the connection".into()),
                },
            }
        }
    }

    pub(crate) async fn ask(&mut self) -> Outcome {
        Ok(self.to_master.send(&WorkRequest::Ready).await?)
    }

    /// Of whatever tile.
    pub(crate) async fn tell_done(&mut self, done: &TileDone, receipt: Mac) -> Outcome {
        Ok(self.to_master.send(&WorkRequest::Done { done: Box::new(done.clone()), receipt }).await?)
    }

    pub(crate) async fn send_tile(&mut self, traced: &Traced) -> Outcome {
        let mut planes = Vec::new();
        traced.pixels.write_bytes(&mut planes);
        self.send_planes(traced.done.tile, traced.done.attempt, traced.permit, &planes).await
    }

    /// Whatever the planes are, in the name of an attempt.
    pub(crate) async fn send_planes(&mut self, tile: TileId, attempt: Attempt, permit: Mac, planes: &[u8]) -> Outcome {
        let crc32c = crc32c::crc32c(planes);
        self.send_with_crc(TilePixels { tile, attempt, permit, crc32c }, planes).await
    }

    pub(crate) async fn send_with_crc(&mut self, pixels: TilePixels, planes: &[u8]) -> Outcome {
        Ok(self.to_display.send_with_bulk(&pixels, planes).await?)
    }

    /// The next answer of the display, whatever it is.
    pub(crate) async fn await_reply(&mut self) -> Outcome {
        self.from_display.receive().await?.map(drop).ok_or_else(|| "the display closed the connection".into())
    }
}
