//! The secret of a run, made and kept. It goes from process to process by a pipe or a file, never by an argument,
//! which other users can read.

use std::io;
use std::path::Path;

use crate::protocol::hello::RunToken;
use ground::secret_file;

/// A token's file is 65 bytes.
const BYTES_MAX: u64 = 256;

/// A new secret.
///
/// # Errors
/// The system has no random numbers.
pub fn random() -> io::Result<RunToken> {
    random_bytes().map(RunToken::new)
}

/// # Errors
/// The system has no random numbers.
pub fn random_bytes() -> io::Result<[u8; 32]> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(|error| io::Error::other(error.to_string()))?;
    Ok(bytes)
}

/// Writes a new file that only its owner can read, in the place of an earlier one.
///
/// # Errors
/// It cannot be written; the error names it.
pub fn write(path: &Path, token: RunToken) -> io::Result<()> {
    secret_file::write(path, &(token.to_hexadecimal() + "\n"))
}

/// # Errors
/// The file is not there, others can read it, or it holds no token; the error names it.
pub fn read(path: &Path) -> io::Result<RunToken> {
    let text = secret_file::read(path, BYTES_MAX)?;
    RunToken::from_hexadecimal(text.trim()).ok_or_else(|| secret_file::named(path, "expected 64 hexadecimal digits"))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_token_is_read_back_and_hidden_from_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        let token = random().expect("random numbers");
        for _ in 0..2 {
            write(&path, token).expect("a folder to write to");
            assert_eq!(fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o600);
            assert!(read(&path).expect("a token") == token);
        }
        assert!(random().expect("random numbers") != token);
    }

    #[test]
    fn what_is_no_secret_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("token");
        let refused = |text: &str, mode| {
            fs::write(&path, text).expect("writable");
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("ours");
            read(&path).expect_err("refused").to_string()
        };
        let good = RunToken::new([0xab; 32]).to_hexadecimal();
        assert!(refused(&good, 0o640).ends_with("token: its mode is 640: others can read the secret, expected 600"));
        for text in ["", "abc", &good[1..], &format!("{good}0"), &good.replace('a', "g")] {
            assert!(refused(text, 0o600).ends_with("expected 64 hexadecimal digits"), "{text}");
        }
        fs::remove_file(&path).expect("there");
        assert!(read(&path).expect_err("not there").to_string().contains("No such file"));
    }
}
