//! What a bus's control conversation may be given.

use super::super::hostile::Forge;
use super::machine::Arbitrary;
use crate::processes::bus::control::{Answer, Control, Never, Task};
use crate::processes::driver::PeerId;
use crate::protocol::control::{BusCommand, BusConfiguration};
use ground::ids::ClusterId;
use machine::hardware::specification::Arbiter;
use machine::hardware::totals::BusTotals;
use trace::database::{Layout, Section};

impl Arbitrary for Control {
    /// To serve, and to finish.
    const TASKS_MAX: usize = 2;

    fn begin() -> Self {
        Self::default()
    }

    fn command(forge: &mut Forge) -> BusCommand {
        match forge.dice.below(3) {
            0 => BusCommand::Finish { lost: forge.lost() },
            _ => BusCommand::Configure(BusConfiguration {
                cluster: ClusterId(0),
                arbiter: Arbiter::Fifo,
                layout: Layout::new([8; Section::COUNT]).expect("small"),
                recording: "recording".into(),
            }),
        }
    }

    fn message(_forge: &mut Forge, _peer: PeerId, _sent: &[Never]) -> Option<Never> {
        None
    }

    fn answer(forge: &mut Forge, _task: Task) -> Answer {
        match forge.dice.below(4) {
            0 => Answer::Incident("an incident".to_owned()),
            1 => Answer::Ended(Err("a failure".to_owned())),
            _ => Answer::Ended(Ok(BusTotals { fetches: forge.count(), ..BusTotals::default() })),
        }
    }
}
