//! One branch of the octree on a ray's way: its planes, and the children that the ray crosses, in order.

use glam::{BVec4A, Vec4, Vec4Swizzles};

use super::prepared::least_axis;

/// A branch that the ray is in, and what is left of its way. Lanes are the axes.
#[derive(Clone, Copy, Default)]
pub(super) struct Branch {
    /// Half the ray parameters of the cell's near and far planes: the mid planes are their sum, and the halves of
    /// these are planes of the children.
    near: Vec4,
    far: Vec4,
    /// Ray parameters of the mid planes; the fourth: where the ray leaves the cell.
    mid: Vec4,
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

/// Set in the lanes of an octant's axes.
const UPPER: [BVec4A; 8] = {
    let mut masks = [BVec4A::FALSE; 8];
    let mut child = 0;
    while child < 8 {
        masks[child] = BVec4A::new(child & 1 != 0, child & 2 != 0, child & 4 != 0, false);
        child += 1;
    }
    masks
};

/// Set in the lane that is of no axis.
const FOURTH: BVec4A = BVec4A::new(false, false, false, true);

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
    pub near: Vec4,
    pub far: Vec4,
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
    pub(super) fn root(near: Vec4, far: Vec4, enter: f32, leave: f32) -> Self {
        let half = Vec4::splat(HALF);
        Self { near: near * half, far: far * half, word: 0, level: 0, enter, leave, is_last: true }
    }
}

impl Branch {
    /// The branch that a step leads to, whose children are the block `words`, mirrored; and the step to the first
    /// of them. By masks and minima, since what lies deeper waits for it; the other steps are from a table.
    #[inline(always)]
    pub(super) fn enter(at: Step, mid: Vec4, words: u32) -> (Self, Step) {
        let (leaves, middle) = (Vec4::splat(at.leave), mid * Vec4::splat(HALF));
        let upper = mid.cmple(Vec4::splat(at.enter));
        let (near, far) = (Vec4::select(upper, middle, at.near), Vec4::select(upper, at.far, middle));
        let leave = least_axis(Vec4::select(upper, leaves, mid));
        let leave = if leave < at.leave { leave } else { at.leave };
        let first = upper.bitmask() & 7;
        let crossed = mid.cmplt(leaves).bitmask() & !first & 7;
        // x, y, x not after y, z, z.
        let order = mid.xyxw().cmple(mid.yzzw()).bitmask() & 7;
        let each = first * 0x0101_0101;
        let steps = STEPS[(crossed << 3 | order) as usize] | each;
        let level = at.level + 1;
        let step = Step { near, far, word: words ^ first, level, enter: at.enter, leave, is_last: crossed == 0 };
        let mid = Vec4::select(FOURTH, leaves, mid);
        (Self { near: at.near, far: at.far, mid, words, steps: steps >> 8, enter: leave, level }, step)
    }

    /// Takes the next step, of which there must be one.
    #[inline(always)]
    pub(super) fn step(&mut self) -> Step {
        let axis = self.steps >> 3 & 3;
        let child = self.steps & 7;
        let upper = UPPER[child as usize];
        let middle = self.mid * Vec4::splat(HALF);
        let step = Step {
            near: Vec4::select(upper, middle, self.near),
            far: Vec4::select(upper, self.far, middle),
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
