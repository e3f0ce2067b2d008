//! What a display may be given.

use bytes::Bytes;

use super::super::hostile::Forge;
use super::machine::{Arbitrary, TILES};
use crate::journal::Record;
use crate::processes::display::state::{Answer, Incoming, Outgoing, State, Task};
use crate::processes::driver::PeerId;
use crate::protocol::control::{DisplayCommand, DisplayConfiguration, DisplayTotals};
use crate::protocol::hello::Role;
use crate::protocol::image::TilePixels;
use crate::protocol::mac::{Claim, MacKey};
use ground::ids::RunId;
use trace::picture::{AovSet, Sides, Tiling};

const KEY: MacKey = MacKey::new([1; 32]);
/// Of a pixel, which is a tile.
const PLANES_BYTES: usize = 12;

impl Arbitrary for State {
    /// To restore, or to write.
    const TASKS_MAX: usize = 1;

    fn begin() -> Self {
        Self::new(RunId(1))
    }

    fn command(forge: &mut Forge) -> DisplayCommand {
        match forge.dice.below(8) {
            0 => DisplayCommand::Finish,
            1 | 2 => DisplayCommand::Condemn(forge.producer()),
            3 => DisplayCommand::TellHoldings { question: forge.dice.below(3) as u32 },
            _ => DisplayCommand::Configure(DisplayConfiguration {
                tiling: Tiling::new(Sides { width: TILES, height: 1, tile_width: 1, tile_height: 1 })
                    .expect("possible"),
                aov: AovSet::default(),
                journal: "tiles".into(),
                resume: forge.dice.chance(50),
                fingerprint: [0; 32],
                key: KEY,
                image: "image.png".into(),
                exr: false,
            }),
        }
    }

    fn message(forge: &mut Forge, peer: PeerId, _sent: &[Outgoing]) -> Option<Incoming> {
        let Role::Node(node) = peer.role else { return None };
        let (tile, attempt) = (forge.tile(), forge.attempt());
        let claim = Claim { tile, attempt, node, epoch: peer.epoch };
        let permit = if forge.dice.chance(90) { KEY.permit(claim) } else { forge.mac() };
        let length = if forge.dice.chance(90) { PLANES_BYTES } else { forge.dice.below(20) as usize };
        // Of two kinds, and some that are not finite.
        let value = if forge.dice.chance(90) { forge.dice.below(2) as u8 } else { 0xff };
        let planes = Bytes::from(vec![value; length]);
        let crc32c = crc32c::crc32c(&planes) ^ u32::from(forge.dice.chance(5));
        Some(Incoming { tile: TilePixels { tile, attempt, permit, crc32c }, planes })
    }

    fn is_done_at_once(task: &Task) -> bool {
        matches!(task, Task::Append(_))
    }

    fn answer(forge: &mut Forge, task: Task) -> Answer {
        match task {
            Task::Restore(mut composition, _) => {
                for _ in 0..forge.dice.below(4) {
                    let (attempt, producer) = (forge.attempt(), forge.producer());
                    composition.restore(&match forge.dice.below(4) {
                        0 => Record::Condemned(producer),
                        _ => Record::Pixels { tile: forge.tile(), attempt, producer, planes: &[0; PLANES_BYTES] },
                    });
                }
                Answer::Restored(composition, forge.dice.chance(20).then(|| "a torn record".to_owned()))
            }
            Task::Append(_) | Task::Write(_) if forge.dice.chance(20) => Answer::Written(Err("full".to_owned())),
            Task::Append(_) | Task::Write(_) => Answer::Written(Ok(DisplayTotals {
                sha256: String::new(),
                tiles_done: 0,
                tiles_stale: 0,
                wire_bytes: 0,
                written: Vec::new(),
            })),
        }
    }
}
