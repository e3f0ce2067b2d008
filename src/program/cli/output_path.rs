//! Where a command writes its output: checked before it begins its work.

use std::path::Path;

use super::Failure;

/// Whether a file can be there. Its folder is not made: a name is easily mistyped.
///
/// # Errors
/// Its folder does not exist or is none, or the file is a folder.
pub(super) fn check(file: &Path) -> Result<(), Failure> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let refuse = |what: String| Err(Failure::bad_input(format!("{}: cannot be written, {what}", file.display())));
    match folder.metadata() {
        Ok(found) if !found.is_dir() => refuse(format!("{} is not a folder", folder.display())),
        Ok(_) if file.is_dir() => refuse("it is a folder, expected the name of a file".to_owned()),
        Ok(_) => Ok(()),
        Err(error) => refuse(format!("the folder {} cannot be used: {error}", folder.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_needs_a_folder_that_exists() {
        let folder = tempfile::tempdir().expect("a folder");
        let plain = folder.path().join("plain");
        std::fs::write(&plain, "").expect("a file");
        for file in [Path::new("a.png"), &plain, &folder.path().join("new.png")] {
            assert_eq!(check(file), Ok(()), "{}", file.display());
        }
        for (file, expected) in [
            (folder.path().join("none/a.png"), "none cannot be used: No such file or directory"),
            (plain.join("a.png"), "plain is not a folder"),
            (folder.path().to_owned(), "it is a folder"),
        ] {
            let failure = check(&file).expect_err(expected);
            assert!(failure.message.contains(expected), "{failure}");
        }
    }
}
