//! A schedule of faults as a person writes it, and what comes of it once it is known who takes part.

use std::fmt;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use super::{Deed, Fault, Kind, Percent, ProcessSlot, Seconds, Target, When};
use ground::ids::{ClusterId, NodeId};

/// More faults than this are refused, those of `random(N)` included.
pub(super) const FAULTS_MAX: usize = 256;

/// Faults in the order in which they were written. Its text reads back as the same schedule.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FaultSchedule {
    pub(super) entries: Vec<Entry>,
    /// Of all that is left to chance.
    pub(super) seed: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Entry {
    Fault(Fault<Target>),
    /// So many faults of any sort but `corrupt`, which only a verified run survives; on any slot, or on one of these.
    Random {
        count: u16,
        kind: Option<Kind>,
    },
}

/// How many processes take part.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Cast {
    /// At least 1.
    pub clusters: u16,
    /// Of all clusters, at least 1.
    pub nodes: u16,
}

#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("`{fault}`: expected a {kind} from 0 to {last}")]
pub struct NoSuchSlot {
    fault: String,
    kind: Kind,
    last: u16,
}

impl FaultSchedule {
    /// Every fault with its slot: the same for the same seed and cast.
    ///
    /// # Errors
    /// A fault is on a process that does not take part.
    pub fn faults(&self, cast: Cast) -> Result<Vec<Fault>, NoSuchSlot> {
        let mut chance = Chance(Pcg64::seed_from_u64(self.seed));
        let mut faults = Vec::new();
        for entry in &self.entries {
            match *entry {
                Entry::Fault(fault) => {
                    let on = slot(&fault, cast, &mut chance)?;
                    faults.push(Fault { deed: fault.deed, on, when: fault.when });
                }
                Entry::Random { count, kind } => faults.extend((0..count).map(|_| chance.fault(kind, cast))),
            }
        }
        Ok(faults)
    }
}

impl Cast {
    /// How many there are of a kind.
    fn count(self, kind: Kind) -> u16 {
        match kind {
            Kind::Bus | Kind::Master => self.clusters,
            Kind::Node => self.nodes,
            Kind::Display => 1,
        }
    }
}

fn slot(fault: &Fault<Target>, cast: Cast, chance: &mut Chance) -> Result<ProcessSlot, NoSuchSlot> {
    let Target { kind, number } = fault.on;
    let number = number.unwrap_or_else(|| chance.number(kind, cast));
    if number >= cast.count(kind) {
        let last = cast.count(kind).saturating_sub(1);
        return Err(NoSuchSlot { fault: fault.to_string(), kind, last });
    }
    Ok(kind.slot(number))
}

impl Kind {
    fn slot(self, number: u16) -> ProcessSlot {
        match self {
            Self::Bus => ProcessSlot::Bus(ClusterId(number)),
            Self::Master => ProcessSlot::Master(ClusterId(number)),
            Self::Node => ProcessSlot::Node(NodeId(number)),
            Self::Display => ProcessSlot::Display,
        }
    }
}

struct Chance(Pcg64);

impl Chance {
    /// The high half of the product: below `limit`, biased by less than 2⁻³².
    fn below(&mut self, limit: u32) -> u32 {
        ((u128::from(self.0.next_u64()) * u128::from(limit)) >> 64) as u32
    }

    fn number(&mut self, kind: Kind, cast: Cast) -> u16 {
        self.below(u32::from(cast.count(kind))) as u16
    }

    /// Half of the faults kill; nodes, of which there are most, have five of eight. Early enough to be felt, 0.1 s to 2 s.
    fn fault(&mut self, kind: Option<Kind>, cast: Cast) -> Fault {
        let kind = kind.unwrap_or_else(|| match self.below(8) {
            0 => Kind::Bus,
            1 => Kind::Master,
            2 => Kind::Display,
            _ => Kind::Node,
        });
        let on = kind.slot(self.number(kind, cast));
        let time = Seconds(100 * (1 + self.below(20)));
        let deed = match self.below(4) {
            0 => Deed::Stop(time),
            1 => Deed::Cut(time),
            _ => Deed::Kill,
        };
        Fault { deed, on, when: When::Done(Percent(1000 * (1 + self.below(90)))) }
    }
}

impl fmt::Display for FaultSchedule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for entry in &self.entries {
            match entry {
                Entry::Fault(fault) => write!(f, "{fault}; ")?,
                Entry::Random { count, kind: None } => write!(f, "random({count}); ")?,
                Entry::Random { count, kind: Some(kind) } => write!(f, "random({count} {kind}); ")?,
            }
        }
        write!(f, "seed={}", self.seed)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const CAST: Cast = Cast { clusters: 2, nodes: 6 };

    fn read(text: &str) -> FaultSchedule {
        text.parse().expect("a schedule")
    }

    #[test]
    fn what_is_certain_is_as_it_was_written() {
        let faults =
            read("kill node 5@10%; cut bus 1@2s for 1s; stop display@0% for 0.5s").faults(CAST).expect("in it");
        let written: Vec<_> = faults.iter().map(ToString::to_string).collect();
        assert_eq!(written, ["kill node 5@10%", "cut bus 1@2s for 1s", "stop display@0% for 0.5s"]);
    }

    #[test]
    fn who_does_not_take_part_is_named() {
        let refused = |text: &str| read(text).faults(CAST).expect_err("too many").to_string();
        assert_eq!(refused("kill node 6@10%"), "`kill node 6@10%`: expected a node from 0 to 5");
        assert_eq!(refused("kill master 2@10%"), "`kill master 2@10%`: expected a master from 0 to 1");
    }

    #[test]
    fn the_seed_decides_what_is_left_to_chance() {
        let faults = |seed| read(&format!("kill node@10%; random(40); seed={seed}")).faults(CAST).expect("in it");
        assert_eq!(faults(3), faults(3));
        assert_ne!(faults(3), faults(4));
        assert_eq!(faults(3).len(), 41);
        let of = |kind| faults(3)[1..].iter().filter(|fault| fault.on.kind() == kind).count();
        assert!(of(Kind::Node) > 15 && of(Kind::Bus) > 0 && of(Kind::Master) > 0 && of(Kind::Display) > 0);
        assert!(faults(3).iter().all(|fault| fault.deed != Deed::Corrupt));
        let nodes = read("random(40 node)").faults(CAST).expect("in it");
        assert!((0..6).all(|node| nodes.iter().any(|fault| fault.on == ProcessSlot::Node(NodeId(node)))));
    }

    fn entry() -> impl Strategy<Value = Entry> {
        let kind = prop_oneof![Just(Kind::Bus), Just(Kind::Master), Just(Kind::Node), Just(Kind::Display)];
        let seconds = || (1..=Seconds::MAX).prop_map(Seconds);
        let deed = prop_oneof![Just(Deed::Kill), seconds().prop_map(Deed::Stop), seconds().prop_map(Deed::Cut)];
        let when = prop_oneof![
            (0..Percent::LIMIT).prop_map(|share| When::Done(Percent(share))),
            (0..=Seconds::MAX).prop_map(|time| When::After(Seconds(time))),
        ];
        let target = (kind.clone(), proptest::option::of(any::<u16>()));
        let target =
            target.prop_map(|(kind, number)| Target { kind, number: number.filter(|_| kind != Kind::Display) });
        let corrupt = |(mut fault, corrupt): (Fault<Target>, bool)| {
            if corrupt && fault.on.kind == Kind::Node {
                fault.deed = Deed::Corrupt;
            }
            Entry::Fault(fault)
        };
        let fault = (deed, target, when).prop_map(|(deed, on, when)| Fault { deed, on, when });
        let random = (1..=20u16, proptest::option::of(kind)).prop_map(|(count, kind)| Entry::Random { count, kind });
        prop_oneof![4 => (fault, any::<bool>()).prop_map(corrupt), 1 => random]
    }

    proptest! {
        #[test]
        fn a_schedule_reads_back(entries in proptest::collection::vec(entry(), 1..12), seed: u64) {
            let schedule = FaultSchedule { entries, seed };
            prop_assert_eq!(schedule.to_string().parse(), Ok(schedule.clone()));
            // So does what came of it.
            if let Ok(faults) = schedule.faults(Cast { clusters: u16::MAX, nodes: u16::MAX }) {
                let text = faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
                let again = read(&text).faults(Cast { clusters: u16::MAX, nodes: u16::MAX });
                prop_assert_eq!(again, Ok(faults));
            }
        }
    }
}
