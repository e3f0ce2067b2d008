//! The JSON schema of report.json, published as docs/report.schema.json.

use schemars::generate::SchemaSettings;

use super::Report;

/// The schema as JSON text, ending in a newline.
///
/// # Errors
/// None is known: a schema is JSON.
pub fn json() -> Result<String, serde_json::Error> {
    let schema = SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<Report>();
    serde_json::to_string_pretty(&schema).map(|text| text + "\n")
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use serde_json::Value;

    use crate::report::fixture;

    /// Set to have the published schema written anew instead of compared.
    const UPDATE: &str = "MARTI_UPDATE";

    #[test]
    fn the_published_schema_is_that_of_the_code() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/report.schema.json");
        let schema = super::json().expect("is JSON");
        if std::env::var_os(UPDATE).is_some() {
            fs::write(&path, &schema).expect("can be written");
        }
        let published = fs::read_to_string(&path).unwrap_or_default();
        assert!(published == schema, "docs/report.schema.json is out of date: run the tests with {UPDATE}=1");
    }

    #[test]
    fn the_schema_has_every_key_of_a_report() {
        let schema: Value = serde_json::from_str(&super::json().expect("is JSON")).expect("is JSON");
        let properties = schema["properties"].as_object().expect("an object has properties");
        let report = serde_json::to_value(fixture::report()).expect("is JSON");
        for key in report.as_object().expect("a report is an object").keys() {
            assert!(properties.contains_key(key), "{key}");
        }
    }
}
