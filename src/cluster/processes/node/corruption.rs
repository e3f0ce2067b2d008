//! A node that is made to err (`marti run --chaos "corrupt node …"`), so that one can see it found out.

use crate::protocol::hello::Role;
use ground::ids::TileId;
use trace::picture::Pixels;

/// Turns one bit of every tile's colours around, the last one of a number, so that nothing but a comparison finds it: another
/// bit where a tile has fewer pixels than the run has nodes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corruption {
    /// Two such nodes do not agree with each other.
    salt: usize,
}

/// Of an f32: with any of them changed, it is still finite.
const MANTISSA_BITS: usize = 23;

impl Corruption {
    pub(super) fn of(role: Role) -> Self {
        let Role::Node(node) = role else { return Self { salt: 0 } };
        Self { salt: usize::from(node.0) }
    }

    pub(super) fn flip_a_bit(self, pixels: &mut Pixels, tile: TileId) {
        let count = pixels.colour.len().max(1);
        let (at, bit) = ((tile.0 as usize + self.salt) % count, self.salt / count % MANTISSA_BITS);
        if let Some([red, ..]) = pixels.colour.get_mut(at) {
            *red = f32::from_bits(red.to_bits() ^ 1 << bit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ground::ids::NodeId;

    #[test]
    fn one_bit_of_a_tile_is_wrong_and_another_one_of_another_node() {
        let right = Pixels { colour: vec![[0.5; 3]; 9], ..Pixels::default() };
        let wrong = |node, tile| {
            let mut pixels = right.clone();
            Corruption::of(Role::Node(NodeId(node))).flip_a_bit(&mut pixels, TileId(tile));
            pixels
        };
        let bits = |pixels: &Pixels| pixels.colour.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
        let flipped: u32 = bits(&right).iter().zip(bits(&wrong(1, 30))).map(|(a, b)| (a ^ b).count_ones()).sum();
        assert_eq!(flipped, 1);
        assert_ne!(wrong(1, 30), wrong(2, 30));
        assert_ne!(wrong(1, 30), wrong(10, 30), "the same pixel, another bit");
        Corruption::of(Role::Node(NodeId(1))).flip_a_bit(&mut Pixels::default(), TileId(2));
    }
}
