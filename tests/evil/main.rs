//! One node of four is evil (`tests/evil/node`, each of whose modes has the test of its name here), the other processes
//! are the real ones: the image is right, or the run fails in so many words.

mod completions;
mod connections;
mod impostors;
mod pixels;
mod reports;
mod resume;
mod run;
mod time;

#[test]
fn every_mode_has_a_test() {
    let tests = [
        include_str!("completions.rs"),
        include_str!("connections.rs"),
        include_str!("impostors.rs"),
        include_str!("pixels.rs"),
        include_str!("reports.rs"),
        include_str!("time.rs"),
    ];
    let lines = include_str!("node/mode.rs").lines().map(str::trim);
    let modes = lines.filter_map(|line| line.strip_suffix(',')).filter(|name| name.chars().all(char::is_alphanumeric));
    let modes: Vec<String> = modes.map(str::to_lowercase).collect();
    assert!(modes.len() > 50, "{modes:?}");
    for mode in modes {
        assert!(
            tests
                .iter()
                .any(|test| test.contains(&format!("fn {mode}()")) || test.contains(&format!("\n    {mode}: "))),
            "{mode} has no test"
        );
    }
}
