//! What an evil node does.

use clap::ValueEnum;

/// Written in small letters as one word, here as in the names of the tests. What is not said is done as a true node
/// does it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
#[value(rename_all = "lower")]
pub(crate) enum Mode {
    // Pixels.
    /// Reports tiles done whose pixels it never sends.
    NoPixels,
    /// Sends grey pixels of all tiles as attempt 0, before it is handed any.
    Ahead,
    /// Sends its first tile in grey under the highest attempt number there is.
    MaxAttempt,
    /// Sends each of its tiles in grey under the number of the attempt after its own.
    NextAttempt,
    /// Sends one tile again and again, and never reads what the display answers.
    NoRead,
    /// Sends pixels that are no numbers.
    Nan,
    /// Sends infinite pixels.
    Infinite,
    /// Sends grey pixels.
    Grey,
    /// Sends grey pixels of the tiles in the last eighth of the image.
    GreyLast,
    /// Sends grey pixels of all tiles but its first and those that it is to check.
    GreyLater,
    /// Sends grey pixels, and reports its first tile done, no other.
    GreyHeld,
    /// Sends grey pixels of tiles that were rendered before: it is to check them.
    FalseChecker,
    /// Sends pixels with a wrong checksum.
    BadCrc,
    /// Sends a pixel more than the tile has.
    Oversize,
    /// Sends a pixel less than the tile has.
    Undersize,
    /// Sends pixels of a tile that the image does not have.
    NoSuchTile,
    /// Sends one tile 200,000 times.
    Duplicates,
    /// Sends each tile in grey, and then as it is.
    Changed,
    /// Sends other pixels of every tile 240 times, all different.
    Disputes,
    // Completions.
    /// Reports tiles done before the display has acknowledged them.
    EarlyDone,
    /// Sends every second tile only, and reports the other ones done with it.
    OtherTile,
    /// Reports tiles done that it was not handed.
    NotHeld,
    /// Reports each tile done twice.
    DoneTwice,
    /// Asks for a tile a thousand times.
    Readies,
    /// Takes tiles, and does nothing with them.
    Hoard,
    /// Reports 2^64 - 1 of whatever is counted.
    MaxCounters,
    /// Reports more misses than accesses.
    MoreMisses,
    /// Reports more primary rays than a tile has pixels.
    WrongRays,
    /// Reports an access and a hit more than there were.
    WrongHits,
    // Time.
    /// Lives, and does nothing.
    Silent,
    /// Does one tile, lives, and asks for no more.
    Lazy,
    /// Keeps each tile for most of the time that it may.
    Sluggard,
    /// Dies after each tile.
    Mortal,
    /// Dies of every tile.
    DieHolding,
    /// Does not end when it is asked to.
    NoFinish,
    // Connections.
    /// Dials the display 2000 times, and leaves.
    Reconnect,
    /// Dials the display until it takes no more, and stays.
    Crowd,
    /// Dials manager and master in other roles than its own.
    Knock,
    /// Speaks to the display, a byte a second.
    SlowDisplay,
    /// Speaks to the master, a byte a second.
    SlowMaster,
    /// Speaks to the bus, a byte a second.
    SlowBus,
    /// Begins frames of four gigabytes at the display, the master and the bus.
    Giant,
    /// Says to each what is for another one.
    Foreign,
    // The bus.
    /// Fetches what there is not.
    BadFetch,
    /// Stores, as the manager alone may.
    Store,
    /// Fetches more than it reports.
    ExtraFetches,
    /// Sends the bus a million messages that are not answered.
    BusMessages,
    /// Asks the bus for all of the database a hundred times, and reads nothing.
    BulkUnread,
    // Others' names.
    /// Sends grey pixels of all tiles in the name of node 1.
    PoseNode,
    /// Comes to the master as node 1, which is there.
    PoseTwice,
    /// Comes to master and bus as a successor of node 1.
    PoseFuture,
    /// Comes to the bus as its master.
    PoseMaster,
    /// Comes to the bus as the manager, and stores.
    PoseLoader,
    // Reports to the manager.
    /// Reports 3000 long incidents with escape codes and the line of another image.
    Incidents,
    /// Reports a failure of 60 KB with escape codes.
    Failed,
    /// Reports that it leaves as it was asked to, and leaves.
    Leaving,
    /// Reports that it has finished, at the beginning.
    Finished,
    /// Reports that it traces packets over 2^64 - 1 bytes.
    Packets,
    /// Sends the manager a million heartbeats.
    ControlFlood,
    /// Says to the manager what is for the master.
    ForeignControl,
}
