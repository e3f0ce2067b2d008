//! The mailbox (paper, section 5.3): a primitive that is in many leaves is tested once a ray.
//!
//! Arnaldi, Priol, Bouatouch, 1987, keep the last ray's number with every object. Here a small direct-mapped
//! table keeps the last primitives of the current ray: it stays in the first-level cache, whatever the scene,
//! and at worst forgets one, which costs a test and changes nothing else.

use crate::database::records::PrimitiveId;

const ENTRIES: usize = 256;

pub struct Mailbox {
    /// Ray number in the upper half, primitive in the lower.
    seen: Box<[u64; ENTRIES]>,
    ray: u64,
}

impl Mailbox {
    pub fn new() -> Self {
        // No ray has number 0.
        Self { seen: Box::new([0; ENTRIES]), ray: 1 }
    }

    /// From here on for another ray: nothing has been seen. Every 2³² rays the table is wiped.
    pub fn next_ray(&mut self) {
        self.ray = (self.ray + 1) & u64::from(u32::MAX);
        if self.ray == 0 {
            *self = Self::new();
        }
    }

    /// Whether the primitive was seen before by this ray; it is from now on.
    #[inline(always)]
    pub fn seen(&mut self, primitive: PrimitiveId) -> bool {
        let key = self.ray << 32 | u64::from(primitive.0);
        let entry = &mut self.seen[primitive.0 as usize % ENTRIES];
        std::mem::replace(entry, key) == key
    }
}

impl Default for Mailbox {
    fn default() -> Self {
        Self::new()
    }
}
