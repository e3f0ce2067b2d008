//! What processes report, and what becomes of it.

use super::*;

impl State {
    pub(super) fn told_by_bus(&mut self, id: ProcessId, report: BusReport) {
        let Role::Bus(cluster) = id.role else { return };
        match report {
            BusReport::Heartbeat | BusReport::Incident(_) => {}
            // It cannot write its recording, as a rule. While the run goes on another one takes its place; at the end of
            // the run no process can write what is missing.
            BusReport::Failed(why) if self.ending.is_running() => self.supervision.kill(id, format!("failed: {why}")),
            BusReport::Failed(why) => self.fail(format!("{id} failed: {why}")),
            BusReport::Listening(address) => self.clusters.bus_listens(id, cluster, address, &mut self.supervision),
            BusReport::Finished(_) if self.ending.is_running() => self.ends_early(id),
            BusReport::Finished(totals) => {
                self.supervision.enter(id, Stage::Finished);
                self.tiles.ledger.book((cluster, id.epoch)).bus = Some(totals);
            }
        }
    }

    pub(super) fn told_by_node(&mut self, id: ProcessId, report: NodeReport) {
        match report {
            NodeReport::Heartbeat | NodeReport::Incident(_) => {}
            NodeReport::Failed(why) => self.supervision.kill(id, format!("failed: {why}")),
            NodeReport::Leaving => {
                if let Some(process) = self.supervision.table.get_mut(id) {
                    process.leaving = true;
                }
            }
            NodeReport::Packets(packets) => self.tiles.ledger.packets = Some(packets),
            NodeReport::Finished if self.ending.is_running() => self.ends_early(id),
            NodeReport::Finished => self.supervision.enter(id, Stage::Finished),
        }
    }

    pub(super) fn told_by_display(&mut self, id: ProcessId, report: DisplayReport) {
        let total = self.tiles.queue.total();
        match report {
            DisplayReport::Restored(ref holdings) | DisplayReport::Holdings { ref holdings, .. }
                if holdings.shares.iter().any(|share| share.latest.0 >= total) =>
            {
                self.supervision.kill(id, format!("reported a tile that an image of {total} does not have"));
            }
            DisplayReport::Restored(_) if !self.display.restores() => {
                self.supervision.kill(id, "reported twice what it restored".to_owned());
            }
            DisplayReport::Heartbeat | DisplayReport::Incident(_) => {}
            DisplayReport::Failed(why) => self.supervision.kill(id, format!("failed: {why}")),
            DisplayReport::Restored(holdings) if self.display.epoch == Epoch(0) => self.tiles.resume(&holdings),
            DisplayReport::Restored(holdings) => self.require(&holdings, "the journal"),
            DisplayReport::Listening(address) => {
                self.display.listens(id, address, &mut self.supervision);
                // Its predecessor may not have done what it was asked.
                for process in self.tiles.verification.condemned() {
                    self.display.condemn(process, &mut self.supervision);
                }
                self.tiles.ask_for_comparisons();
                self.configure_nodes();
            }
            DisplayReport::Compared(comparison) => self.compared(&comparison),
            DisplayReport::Forged { node, .. } if node.0 >= self.supervision.plan.cluster.all_nodes() => {
                self.supervision.kill(id, format!("reported about {node}, which does not exist"));
            }
            DisplayReport::Forged { node, epoch, why } => {
                self.condemn(self.producer(node, epoch), &format!("it sent what is not its own: {why}"));
            }
            DisplayReport::Condemned(process, tiles) => {
                // It has taken these tiles out of the frame.
                if self.tiles.verification.is_condemned(process) {
                    let gone = self.tiles.redo(|tile, _| tiles.contains(tile));
                    if gone > 0 && self.ending.is_completing() {
                        self.fail(format!("the display took {gone} tiles out after the last one"));
                    }
                }
            }
            DisplayReport::Holdings { question, holdings } => {
                if self.display.answers(question) {
                    self.require(&holdings, "the display");
                    self.display.shares = holdings.shares;
                }
            }
            DisplayReport::Finished(_) if !self.supervision.is_at(id, Stage::Working) => self.ends_early(id),
            DisplayReport::Finished(totals) => {
                if self.ending.is_completing() && totals.tiles_done != total {
                    self.fail(format!("the display wrote {} of {total} tiles", totals.tiles_done));
                }
                self.supervision.enter(id, Stage::Finished);
                self.tiles.ledger.display = Some(totals);
            }
        }
    }

    pub(super) fn told_by_master(&mut self, id: ProcessId, report: MasterReport) {
        let Role::Master(cluster) = id.role else { return };
        if let Some(node) = report.node().filter(|node| !self.clusters.has(cluster, *node)) {
            return self.supervision.kill(id, format!("reported about {node}, which is none of its nodes"));
        }
        match report {
            MasterReport::Heartbeat | MasterReport::Incident(_) => {}
            MasterReport::Listening(address) => {
                self.clusters.master_listens(id, cluster, address, &mut self.supervision);
                self.configure_nodes();
            }
            MasterReport::TilesWanted(tiles) => {
                let out = self.tiles.queue.out_of_cluster(cluster);
                self.clusters.want(cluster, tiles, out, self.supervision.plan.run.threads);
            }
            MasterReport::NodeReady { node, epoch } => {
                self.tiles.ledger.first_tile.get_or_insert(self.supervision.now);
                let id = ProcessId { role: Role::Node(node), epoch };
                if self.supervision.table.get_mut(id).is_some_and(|node| node.stage == Stage::Serving) {
                    self.supervision.enter(id, Stage::Working);
                }
            }
            MasterReport::Done { node, epoch, done } => {
                self.done((cluster, id.epoch), self.producer(node, epoch), &done);
            }
            MasterReport::Lost(lost) => {
                self.tiles.lose((cluster, id.epoch), lost);
            }
            MasterReport::Returned(grants) => {
                for (tile, attempt) in grants {
                    if self.tiles.queue.is_out(cluster, tile, attempt) {
                        self.tiles.queue.lose(tile, attempt);
                    }
                }
            }
            MasterReport::Forged { node, epoch, why } => self.condemn(self.producer(node, epoch), &why),
            MasterReport::Idle { node, epoch } => {
                // Another process of it might do one tile, and wait again.
                let deadline = seconds(self.supervision.plan.run.deadlines.tile);
                let why = format!("asked for no tile for more than {deadline}");
                self.set_aside(node, &format!("it {why}"));
                self.supervision.kill(ProcessId { role: Role::Node(node), epoch }, why);
            }
            MasterReport::Late { node, epoch, tile } => {
                let deadline = seconds(self.supervision.plan.run.deadlines.tile);
                let why = format!("held {tile} for more than {deadline}");
                self.supervision.kill(ProcessId { role: Role::Node(node), epoch }, why);
            }
            MasterReport::Finished(_) if self.ending.is_running() => self.ends_early(id),
            MasterReport::Finished(totals) => {
                self.supervision.enter(id, Stage::Finished);
                self.tiles.ledger.book((cluster, id.epoch)).master = Some(totals);
            }
        }
    }

    pub(super) fn ends_early(&mut self, id: ProcessId) {
        self.supervision.kill(id, "reported its end before it was asked to end".to_owned());
    }
}
