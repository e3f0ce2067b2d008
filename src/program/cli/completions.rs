//! `marti completions SHELL` and `marti man FOLDER`: the command line as shells and `man` know it.

use std::fs;
use std::path::PathBuf;

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use ground::atomic_file;

use super::{Arguments, Failure, print};

/// Print completions of the command line for a shell
#[derive(Clone, Debug, Args)]
pub(super) struct CompletionsArguments {
    /// The shell that reads them
    shell: Shell,
}

/// Write a man page for each command
#[derive(Clone, Debug, Args)]
pub(super) struct ManArguments {
    /// The folder, made if it does not exist; files of the same names are replaced
    folder: PathBuf,
}

pub(super) fn completions(arguments: &CompletionsArguments) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Arguments::command(), "marti", &mut script);
    print(&String::from_utf8_lossy(&script))
}

pub(super) fn man(arguments: &ManArguments) -> Result<(), Failure> {
    let folder = &arguments.folder;
    let failed = |error: std::io::Error| Failure::failed(error.to_string());
    fs::create_dir_all(folder).map_err(|error| Failure::bad_input(format!("{}: {error}", folder.display())))?;
    let mut root = Arguments::command().disable_help_subcommand(true);
    root.build();
    let mut commands = vec![root];
    while let Some(command) = commands.pop() {
        let page = clap_mangen::Man::new(command.clone());
        atomic_file::write(&folder.join(page.get_filename()), |file| page.render(file)).map_err(failed)?;
        commands.extend(command.get_subcommands().cloned());
    }
    Ok(())
}
