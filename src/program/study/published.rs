//! What the paper publishes, as numbers: M-P. Hébert, M. D. J. McNeill, B. Shah, R. L. Grimsdale, P. F. Lister,
//! *MARTI, a Multiprocessor Architecture for Ray Tracing Images*, 1991. Figures 6 and 7 are curves without numbers.

use machine::hardware::specification::MemorySize;

/// Section 7: a cluster computes 2500 tiles of 5×5 pixels.
pub const IMAGE_SIDE: u32 = 250;
pub const TILE_SIDE: u32 = 5;
/// Section 7, Figures 6 and 7.
pub const NODES: [u16; 2] = [4, 9];

/// Figure 1 and section 2.2, the teapot: the octree's deepest levels, how many of its nodes they hold, and how many
/// of the accesses.
pub const DEEPEST_LEVELS: u32 = 4;
pub const DEEPEST_NODES_SHARE: f64 = 0.565;
pub const DEEPEST_ACCESSES_SHARE: f64 = 0.022;
/// Section 2.2: "the cost in terms of floating point operations increases fourteenfold" without them.
pub const FLOPS_FACTOR: f64 = 14.0;

/// Table 1: shared memory accesses over local memory accesses, nine processors.
pub const TABLE_NODES: u16 = 9;
pub const TABLE_SIZES: [MemorySize; 4] = [share(4), share(8), share(16), share(32)];
pub const TABLE_GEARS: [f64; 4] = [0.005, 0.006, 0.015, 0.027];
pub const TABLE_TEAPOT: [f64; 4] = [0.027, 0.035, 0.038, 0.047];

/// Section 7, the teapot at 1/32: "the communication on the cluster bus is 4.7% of the communication between a
/// unique processor and memory computing the same tiles".
pub const BUS_SHARE: f64 = 0.047;
/// Section 7: "about 87 Kbytes".
pub const LOCAL_BYTES_ABOUT: u64 = 87_000;
/// Section 7: "the communications due to messages are about 200 Kbytes".
pub const MESSAGE_BYTES_ABOUT: u64 = 200_000;
/// Section 7: "thirty-seven processors per cluster will be acceptable". That is 1/0.027, Table 1's last gears cell.
pub const PROCESSORS: u32 = 37;

/// A 1/`denominator` of the database.
pub const fn share(denominator: u32) -> MemorySize {
    MemorySize::Share { numerator: 1, denominator }
}
