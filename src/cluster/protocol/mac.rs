//! Proofs that a node cannot forge: that a tile was handed to its process, and that the display has the pixels.
//!
//! ```text
//! manager ── key ──▶ masters, display (never a node)
//! master  ── job, permit ──▶ node ── pixels, permit ──▶ display
//! display ── receipt ──▶ node ── completion, receipt ──▶ master
//! ```
//!
//! Both are HMAC-SHA256 (RFC 2104) of the attempt and the process, cut to 128 bits. So nothing has to be remembered, or
//! sent between the servers, for a permit or a receipt to be checked.

use std::fmt;

use hmac::{Hmac, KeyInit, Mac as _};
use serde::{Deserialize, Serialize};
use sha2::Sha256;

use ground::ids::{Attempt, Epoch, NodeId, TileId};

/// Of one run. Never printed.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct MacKey([u8; 32]);

/// A permit or a receipt.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug, Serialize, Deserialize)]
pub struct Mac([u8; 16]);

/// An attempt at a tile by a process of this run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Claim {
    pub tile: TileId,
    pub attempt: Attempt,
    pub node: NodeId,
    pub epoch: Epoch,
}

/// What a code vouches for.
#[derive(Clone, Copy)]
enum Statement {
    /// The attempt was handed to the process.
    Permit = 1,
    /// The display has the pixels of the attempt.
    Receipt = 2,
}

impl MacKey {
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The master's: the attempt was handed to the process.
    pub fn permit(&self, claim: Claim) -> Mac {
        self.code(Statement::Permit, claim)
    }

    pub fn is_permit(&self, claim: Claim, mac: Mac) -> bool {
        self.matches(Statement::Permit, claim, mac)
    }

    /// The display's: it has the pixels of the attempt, in the frame or compared with those in the frame.
    pub fn receipt(&self, claim: Claim) -> Mac {
        self.code(Statement::Receipt, claim)
    }

    pub fn is_receipt(&self, claim: Claim, mac: Mac) -> bool {
        self.matches(Statement::Receipt, claim, mac)
    }

    fn code(&self, statement: Statement, claim: Claim) -> Mac {
        let code = self.hash(statement, claim).finalize().into_bytes();
        Mac(std::array::from_fn(|i| code[i]))
    }

    /// In constant time.
    fn matches(&self, statement: Statement, claim: Claim, mac: Mac) -> bool {
        self.hash(statement, claim).verify_truncated_left(&mac.0).is_ok()
    }

    fn hash(&self, statement: Statement, Claim { tile, attempt, node, epoch }: Claim) -> Hmac<Sha256> {
        let mut message = [0; 15];
        message[0] = statement as u8;
        message[1..5].copy_from_slice(&tile.0.to_le_bytes());
        message[5..9].copy_from_slice(&attempt.0.to_le_bytes());
        message[9..13].copy_from_slice(&epoch.0.to_le_bytes());
        message[13..].copy_from_slice(&node.0.to_le_bytes());
        hmac(&self.0, &message)
    }
}

/// HMAC-SHA256 of a message, to be finished or compared.
pub(super) fn hmac(key: &[u8; 32], message: &[u8]) -> Hmac<Sha256> {
    // A key that is shorter than a block is filled with zeros (RFC 2104, section 2).
    let block: [u8; 64] = std::array::from_fn(|i| key.get(i).copied().unwrap_or_default());
    let mut hash = Hmac::<Sha256>::new(&block.into());
    hash.update(message);
    hash
}

impl fmt::Debug for MacKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("MacKey(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: MacKey = MacKey::new([7; 32]);
    const CLAIM: Claim = Claim { tile: TileId(1), attempt: Attempt(2), node: NodeId(3), epoch: Epoch(4) };

    #[test]
    fn a_permit_is_for_one_attempt_of_one_process_under_one_key() {
        let permit = KEY.permit(CLAIM);
        assert!(KEY.is_permit(CLAIM, permit));
        let others = [
            Claim { tile: TileId(0), ..CLAIM },
            Claim { attempt: Attempt(3), ..CLAIM },
            Claim { node: NodeId(0), ..CLAIM },
            Claim { epoch: Epoch(3), ..CLAIM },
        ];
        assert!(others.into_iter().all(|claim| !KEY.is_permit(claim, permit)));
        assert!(!MacKey::new([8; 32]).is_permit(CLAIM, permit));
        assert!(!KEY.is_receipt(CLAIM, permit) && !KEY.is_permit(CLAIM, KEY.receipt(CLAIM)), "one is not the other");
        assert!(KEY.is_receipt(CLAIM, KEY.receipt(CLAIM)));
        assert!(!KEY.is_permit(CLAIM, Mac::default()));
    }

    #[test]
    fn the_code_is_hmac_sha256() {
        // printf '\001\001\0\0\0\002\0\0\0\004\0\0\0\003\0' | openssl dgst -sha256 -mac HMAC -macopt hexkey:0707...
        let expected = "b46fa504b1e262e3e046f4b835bae4dd";
        let found: String = KEY.permit(CLAIM).0.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_key_is_not_printed() {
        assert_eq!(format!("{KEY:?}"), "MacKey(..)");
    }
}
