//! Where a command writes its output: checked before it begins its work.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use nix::unistd::{AccessFlags, access};

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
        Ok(_) if file.is_symlink() && !file.exists() => refuse("it is a link to nothing".to_owned()),
        Ok(_) => match access(folder, AccessFlags::W_OK) {
            Err(error) => refuse(format!("the folder {} cannot be used: {}", folder.display(), error.desc())),
            Ok(()) => Ok(()),
        },
        Err(error) => refuse(format!("the folder {} cannot be used: {error}", folder.display())),
    }
}

/// Whether outputs are files of their own: none is written twice, and none over what the command reads, by whatever name.
///
/// # Errors
/// The output, and what it is the same file as.
pub(super) fn check_apart(outputs: &[(&str, &Path)], inputs: &[&Path]) -> Result<(), Failure> {
    for (at, (option, output)) in outputs.iter().enumerate() {
        let identity = identity(output);
        let is_same = |other: &Path| identity == self::identity(other);
        let refuse = |what: &str| {
            Err(Failure::bad_input(format!("{option} {}: {what}, expected a file of its own", output.display())))
        };
        if inputs.iter().any(|input| is_same(input)) {
            return refuse("the command reads this file");
        }
        if let Some((other, _)) = outputs[..at].iter().find(|(_, other)| is_same(other)) {
            return refuse(&format!("{other} is written to this file"));
        }
    }
    Ok(())
}

/// The same for two names of one file, whether it is there yet or not.
fn identity(file: &Path) -> PathBuf {
    let of_folder = || {
        let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(file.file_name().unwrap_or(OsStr::new(""))))
    };
    file.canonicalize().ok().or_else(of_folder).unwrap_or_else(|| file.to_owned())
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

    #[test]
    fn outputs_are_apart_from_inputs_and_from_each_other() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("scene.obj"), "").expect("a file");
        std::os::unix::fs::symlink(path("scene.obj"), path("link.png")).expect("a link");
        std::fs::create_dir(path("sub")).expect("a folder");
        let scene = path("scene.obj");
        let check = |output: &str, report: &str| {
            check_apart(&[("-o", &path(output)), ("--report", &path(report))], &[&scene])
                .map_err(|failure| failure.message)
        };
        assert_eq!(check("new.png", "new.json"), Ok(()));
        for (output, report, expected) in [
            ("new.png", "sub/../new.png", "-o is written to this file"),
            ("new.png", "scene.obj", "the command reads this file"),
            ("link.png", "x.json", "the command reads this file"),
        ] {
            let message = check(output, report).expect_err(expected);
            assert!(message.contains(expected), "{message}");
        }
    }
}
