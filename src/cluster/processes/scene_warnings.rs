//! Warnings about a scene, on standard error.

use crate::report::incident;
use ground::outlet;
use trace::scene::Warning;

/// Prints each as a line, whatever else is printed.
pub fn show<'a>(warnings: impl IntoIterator<Item = &'a Warning>) {
    for warning in warnings {
        // The name of a file may hold anything.
        outlet::say(format_args!("warning: {}", incident::line(&warning.to_string())));
    }
}
