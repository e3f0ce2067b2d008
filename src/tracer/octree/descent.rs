//! One branch of the octree on a ray's way: its planes, and the children that the ray crosses, in order.

use crate::tracer::simd::four::F32x4;

/// A branch that the ray is in, and what is left of its way. Lanes are the axes.
#[derive(Clone, Copy, Default)]
pub(super) struct Branch {
    /// Half the ray parameters of the cell's near and far planes: the mid planes are their sum, and the halves of
    /// these are planes of the children.
    near: F32x4,
    far: F32x4,
    /// Ray parameters of the mid planes; the fourth: where the ray leaves the cell.
    mid: F32x4,
    /// First word of the children, mirrored.
    words: u32,
    /// The children to come, a byte each: bits 0 to 2 are the child, mirrored; bits 3 and 4 the axis whose mid
    /// plane it is left through, [`LAST`] if that is the cell's own far side.
    steps: u32,
    /// Where the ray enters the next child.
    pub enter: f32,
    /// The children's.
    pub level: u32,
}

/// All set in the lanes of an octant's axes.
const UPPER: [[u32; 4]; 8] = {
    let mut masks = [[0; 4]; 8];
    let mut child = 0;
    while child < 8 {
        let mut axis = 0;
        while axis < 3 {
            if child >> axis & 1 == 1 {
                masks[child][axis] = u32::MAX;
            }
            axis += 1;
        }
        child += 1;
    }
    masks
};

const LAST: u32 = 3;

/// By the axes whose mid planes are crossed (bits 3 to 5), and how these planes are ordered (bits 0 to 2: x not
/// after y, y not after z, x not after z): the steps, for a ray that enters the lowest child.
const STEPS: [u32; 64] = {
    let mut table = [0; 64];
    let mut index = 0;
    while index < 64 {
        table[index] = steps(index as u32 >> 3, index as u32 & 7);
        index += 1;
    }
    table
};

const fn steps(mut crossed: u32, order: u32) -> u32 {
    let (xy, yz, xz) = (order & 1 != 0, order & 2 != 0, order & 4 != 0);
    let (mut steps, mut child, mut step) = (0, 0, 0);
    while crossed != 0 {
        let (x, y, z) = (crossed & 1 != 0, crossed & 2 != 0, crossed & 4 != 0);
        let axis = if x && (!y || xy) && (!z || xz) {
            0
        } else if y && (!z || yz) {
            1
        } else if z {
            2
        } else {
            // No order is like this.
            crossed.trailing_zeros()
        };
        steps |= (child | axis << 3) << (8 * step);
        child |= 1 << axis;
        crossed &= !(1 << axis);
        step += 1;
    }
    steps | (child | LAST << 3) << (8 * step)
}

/// A child on the ray's way.
#[derive(Clone, Copy)]
pub(super) struct Step {
    /// Half the ray parameters of its planes.
    pub near: F32x4,
    pub far: F32x4,
    /// Its octree word.
    pub word: u32,
    pub level: u32,
    /// Where the ray enters and leaves it.
    pub enter: f32,
    pub leave: f32,
    /// There is no child after it.
    pub is_last: bool,
}

const HALF: f32 = 0.5;

impl Step {
    /// Into the root.
    #[inline(always)]
    pub(super) fn root(near: F32x4, far: F32x4, enter: f32, leave: f32) -> Self {
        let half = F32x4::splat(HALF);
        Self { near: near * half, far: far * half, word: 0, level: 0, enter, leave, is_last: true }
    }
}

impl Branch {
    /// The branch that a step leads to, whose children are the block `words`, mirrored; and the step to the first
    /// of them. By masks and minima, since what lies deeper waits for it; the other steps are from a table.
    #[inline(always)]
    pub(super) fn enter(at: Step, mid: F32x4, words: u32) -> (Self, Step) {
        let (leaves, middle) = (F32x4::splat(at.leave), mid * F32x4::splat(HALF));
        let upper = mid.less_or_equal(F32x4::splat(at.enter));
        let (near, far) = (upper.select(middle, at.near), upper.select(at.far, middle));
        let leave = upper.select(leaves, mid).min_axis();
        let leave = if leave < at.leave { leave } else { at.leave };
        let first = upper.signs() & 7;
        let crossed = mid.less(leaves).signs() & !first & 7;
        // x, y, x not after y, z, z.
        let order = mid.shuffle::<0b11_00_01_00>().less_or_equal(mid.shuffle::<0b11_10_10_01>()).signs() & 7;
        let each = first * 0x0101_0101;
        let steps = STEPS[(crossed << 3 | order) as usize] | each;
        let level = at.level + 1;
        let step = Step { near, far, word: words ^ first, level, enter: at.enter, leave, is_last: crossed == 0 };
        let mid = mid.with_last(leaves);
        (Self { near: at.near, far: at.far, mid, words, steps: steps >> 8, enter: leave, level }, step)
    }

    /// Takes the next step, of which there must be one.
    #[inline(always)]
    pub(super) fn step(&mut self) -> Step {
        let axis = self.steps >> 3 & 3;
        let child = self.steps & 7;
        let upper = F32x4::mask(UPPER[child as usize]);
        let middle = self.mid * F32x4::splat(HALF);
        let step = Step {
            near: upper.select(middle, self.near),
            far: upper.select(self.far, middle),
            word: self.words ^ child,
            level: self.level,
            enter: self.enter,
            leave: self.mid.to_array()[axis as usize],
            is_last: axis == LAST,
        };
        self.steps >>= 8;
        self.enter = step.leave;
        step
    }
}
