//! A topology as a list of settings: what two runs were asked for can be compared key by key.

use toml::Value;

use super::Topology;
use super::file::File;

impl Topology {
    /// Every setting, defaults included, by its key: `cluster.nodes` is `4`. Tables of an array are numbered from 0, as in `host.0.name`.
    ///
    /// # Errors
    /// None is known: every topology can be written.
    pub fn settings(&self) -> Result<Vec<(String, String)>, toml::ser::Error> {
        let mut settings = Vec::new();
        collect(String::new(), &Value::try_from(File::from(self))?, &mut settings);
        Ok(settings)
    }
}

fn collect(key: String, value: &Value, settings: &mut Vec<(String, String)>) {
    let within = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        Value::Table(table) => table.iter().for_each(|(name, value)| collect(within(name), value, settings)),
        Value::Array(tables) if tables.iter().any(Value::is_table) => {
            tables.iter().enumerate().for_each(|(i, table)| collect(within(&i.to_string()), table, settings));
        }
        value => settings.push((key, value.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn settings_are_by_key_and_without_gaps() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../topologies/teapot.toml");
        let overrides =
            ["cluster.nodes=9", "light=[{position=[1,2,3]}]"].map(|text| text.parse().expect("an override"));
        let settings = Topology::read(&path, &overrides).expect("a topology").settings().expect("it can be written");
        let of = |key: &str| settings.iter().find(|setting| setting.0 == key).map(|setting| setting.1.as_str());
        assert_eq!(of("cluster.nodes"), Some("9"));
        assert_eq!(of("scene.procedural"), Some("\"teapot\""));
        assert!(of("light.0.position").is_some_and(|position| position.starts_with("[1")), "{settings:?}");
    }
}
