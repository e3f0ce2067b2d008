use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::time::Duration;

use time::OffsetDateTime;

use super::*;

fn folder() -> (tempfile::TempDir, KeyFolder) {
    let folder = tempfile::tempdir().expect("a folder");
    let keys = KeyFolder::at(folder.path());
    keys.create(Validity::days(365)).expect("an empty folder");
    (folder, keys)
}

#[test]
fn new_keys_are_good_for_every_role_and_are_not_written_over() {
    let (folder, keys) = folder();
    let in_a_year = (OffsetDateTime::now_utc() + Duration::from_hours(24 * 365)).date();
    let shown = keys.show().expect("an authority");
    assert_eq!(shown.authority.len(), 32 * 3 - 1);
    assert_eq!(shown.roles.len(), 5);
    for (kind, day) in shown.roles {
        assert_eq!(day.expect("good"), in_a_year, "{kind}");
        let identity = Identity::read(folder.path(), kind).expect("good");
        assert_eq!(format!("{identity:?}"), format!("Identity({kind}, ..)"));
        let mode = fs::metadata(folder.path().join(format!("{kind}.pem"))).expect("there").permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }
    let refused = keys.create(Validity::days(1)).expect_err("there already").to_string();
    assert!(refused.contains("ca.pem is there already: `marti keys rotate`"), "{refused}");
}

#[test]
fn rotation_keeps_the_authority_unless_told_otherwise() {
    let (folder, keys) = folder();
    let before = keys.show().expect("an authority").authority;
    let old = Identity::read(folder.path(), RoleKind::Node).expect("good");
    keys.rotate(Validity::days(7)).expect("a key");
    let new = Identity::read(folder.path(), RoleKind::Node).expect("good");
    assert_ne!(new, old);
    assert_eq!(keys.show().expect("an authority").authority, before);

    keys.rotate_authority(Validity::days(7)).expect("a key");
    assert_ne!(keys.show().expect("an authority").authority, before);
    let newest = Identity::read(folder.path(), RoleKind::Node).expect("good");
    let split = |identity: Identity| {
        let authority = identity.pem.rfind("-----BEGIN CERT").expect("two certificates");
        (identity.pem[..authority].to_owned(), identity.pem[authority..].to_owned())
    };
    let mixed = Identity { kind: RoleKind::Node, pem: split(new).0 + &split(newest).1 };
    let refused = Certificate::of(&mixed).expect("well-formed").check().expect_err("another authority");
    assert_eq!(refused.to_string(), "the certificate of node is not of the authority beside it");
}

#[test]
fn what_is_wrong_with_keys_is_said_before_anybody_dials() {
    let (folder, keys) = folder();
    let read = |kind| Identity::read(folder.path(), kind).expect_err("refused").to_string();
    let authority =
        Authority::from_key(&fs::read_to_string(folder.path().join("ca.key")).expect("ours")).expect("a key");
    let write = |name: &str, text: &str| secret_file_write(folder.path().join(name), text);

    let noon = OffsetDateTime::from_unix_timestamp(1_600_000_000).expect("in range");
    let past = Validity { not_before: noon - Duration::from_hours(24), not_after: noon };
    write("node.pem", &authority.issue(RoleKind::Node, past).expect("random numbers"));
    assert_eq!(
        read(RoleKind::Node),
        "the certificate of node expired on 2020-09-13, make new ones with `marti keys rotate DIR`"
    );
    let far = OffsetDateTime::from_unix_timestamp(7_000_000_000).expect("in range");
    let future = Validity { not_before: far, not_after: far + Duration::from_hours(24) };
    write("node.pem", &authority.issue(RoleKind::Node, future).expect("random numbers"));
    assert!(read(RoleKind::Node).contains("is valid from 2191-10-27 on only"), "{}", read(RoleKind::Node));

    fs::copy(folder.path().join("bus.pem"), folder.path().join("master.pem")).expect("ours");
    assert_eq!(read(RoleKind::Master), "expected the certificate of master, found that of bus");
    write("display.pem", "-----BEGIN CERTIFICATE-----\nAAAA\n");
    assert!(read(RoleKind::Display).starts_with("the keys of display: "), "{}", read(RoleKind::Display));
    let path = folder.path().join("bus.pem");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).expect("ours");
    assert!(read(RoleKind::Bus).ends_with("bus.pem: its mode is 644: others can read the secret, expected 600"));

    let wrong: Vec<bool> = keys.show().expect("an authority").roles.iter().map(|(_, day)| day.is_err()).collect();
    assert_eq!(wrong, [false, true, true, true, true]);
    let key = folder.path().join("ca.key");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o640)).expect("ours");
    assert!(keys.rotate(Validity::days(1)).expect_err("others can read it").to_string().contains("mode is 640"));
}

fn secret_file_write(path: std::path::PathBuf, text: &str) {
    ground::secret_file::write(&path, text).expect("writable");
}
