//! What packets leave to be decided: one ray, one primitive, by the very functions of the single-ray kernel.

use super::packet::Packet;
use crate::database::primitives::PrimitiveIndex;
use crate::database::records::PrimitiveId;
use crate::tracer::hit::{Hit, HitOn};
use crate::tracer::primitives::triangle::Shear;
use crate::tracer::ray::Ray;
use crate::tracer::slices::Slices;

impl Slices<'_> {
    /// The hit of one primitive; whatever its distance.
    pub(super) fn hit(&self, ray: &Ray, id: u32) -> Option<Hit> {
        let primitive = PrimitiveId(id);
        let (t, on) = match self.primitives.counts().locate(primitive)? {
            PrimitiveIndex::Triangle(index) => {
                let triangle = self.primitives.triangles[index as usize];
                let hit = Shear::new(ray).hit(ray, &triangle)?;
                (hit.t, HitOn::Triangle { triangle, barycentrics: hit.barycentrics() })
            }
            curved => {
                let Ok(hit) = HitOn::curved(&mut { *self }, ray, primitive, curved);
                hit?
            }
        };
        Some(Hit { t: t as f32, primitive, on })
    }

    /// Decides exactly whether this primitive's hit is nearer than the lane's so far; if `ANY`, whether there is one.
    #[cold]
    #[inline(never)]
    pub(super) fn contend<const ANY: bool>(&self, packet: &mut Packet, lane: usize, id: u32) {
        let ray = packet.ray(lane);
        let Some(hit) = self.hit(&ray, id) else { return };
        self.settle::<ANY>(packet, lane, &ray, &hit);
    }

    /// A sphere or cone against the rays of `mask`.
    #[inline(never)]
    pub(super) fn test_curved<const ANY: bool>(&self, packet: &mut Packet, mask: u32, id: u32) {
        let mut rest = if ANY { mask & packet.active } else { mask };
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let ray = packet.ray(lane);
            if let Some(hit) = self.hit(&ray, id) {
                self.settle::<ANY>(packet, lane, &ray, &hit);
            }
        }
    }

    fn settle<const ANY: bool>(&self, packet: &mut Packet, lane: usize, ray: &Ray, hit: &Hit) {
        if !(hit.t < ray.t_max) {
            return;
        }
        if ANY {
            packet.active &= !(1 << lane);
            return;
        }
        let id = hit.primitive.0;
        let Some(best) = packet.hit(lane) else { return packet.set_hit(lane, id, hit.t, hit.t, true) };
        if packet.exact >> lane & 1 == 0 && hit.t <= packet.far[lane] && hit.t >= packet.least[lane] {
            let t = self.hit(ray, best).map_or(f32::INFINITY, |hit| hit.t);
            packet.set_hit(lane, best, t, t, true);
        }
        let (least, far) = (packet.least[lane], packet.far[lane]);
        if hit.t < least || (hit.t == least && least == far && id < best) {
            packet.set_hit(lane, id, hit.t, hit.t, true);
        }
    }
}
