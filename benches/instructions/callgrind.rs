//! What callgrind writes: its cost lines, by the object file that they are of.
//!
//! The format is that of valgrind's manual, "Callgrind Format Specification".

use std::collections::HashMap;
use std::path::Path;

/// Instructions executed by the code of one object file. What it called elsewhere is not in them.
///
/// # Errors
/// The text is not callgrind's.
pub(crate) fn instructions_of(text: &str, object: &Path) -> Result<u64, String> {
    if !text.lines().any(|line| line == "events: Ir") {
        return Err("expected callgrind's counts of instructions: events: Ir".to_owned());
    }
    let object = object.to_string_lossy();
    let mut objects: HashMap<&str, &str> = HashMap::new();
    let (mut is_own, mut is_call, mut sum) = (false, false, 0u64);
    for (number, line) in text.lines().enumerate() {
        if let Some(named) = line.strip_prefix("ob=") {
            is_own = name(named, &mut objects) == object;
        } else if let Some(named) = line.strip_prefix("cob=") {
            name(named, &mut objects);
        } else if line.starts_with("calls=") {
            // The line after it has the cost of the call, which is the callee's own.
            is_call = true;
        } else if line.starts_with(|first: char| first.is_ascii_digit() || "+-*".contains(first)) {
            let cost = line.split_whitespace().nth(1).map_or(Ok(0), str::parse::<u64>);
            let cost = cost.map_err(|_| format!("line {}: {line:?}, expected a position and a cost", number + 1))?;
            if is_own && !is_call {
                sum += cost;
            }
            is_call = false;
        }
    }
    Ok(sum)
}

/// `(1) NAME` where a name is first, `(1)` from then on.
fn name<'a>(text: &'a str, known: &mut HashMap<&'a str, &'a str>) -> &'a str {
    match text.split_once(' ') {
        Some((number, name)) if number.starts_with('(') => {
            known.insert(number, name);
            name
        }
        _ => known.get(text).copied().unwrap_or(text),
    }
}
