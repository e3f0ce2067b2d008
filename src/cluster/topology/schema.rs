//! The JSON schema of a topology file, published as docs/topology.schema.json.

use schemars::Schema;
use schemars::generate::SchemaSettings;
use schemars::transform::transform_subschemas;
use serde_json::{Value, json};

use super::file::File;

/// The schema as JSON text, ending in a newline.
///
/// # Errors
/// None is known: a schema is JSON.
pub fn json() -> Result<String, serde_json::Error> {
    let settings = SchemaSettings::draft2020_12().with_transform(without_null);
    let schema = settings.into_generator().into_root_schema_for::<File>();
    serde_json::to_string_pretty(&schema).map(|text| text + "\n")
}

/// A key that may be missing is not one that may be null: TOML has no null.
fn without_null(schema: &mut Schema) {
    if let Some(Value::Array(types)) = schema.get_mut("type") {
        types.retain(|name| name != "null");
        if let [one] = &types[..] {
            let one = one.clone();
            schema.insert("type".to_owned(), one);
        }
    }
    if let Some(Value::Array(mut variants)) = schema.remove("anyOf") {
        variants.retain(|variant| *variant != json!({ "type": "null" }));
        match (&variants[..], schema.as_object_mut()) {
            ([Value::Object(one)], Some(schema)) => schema.extend(one.clone()),
            _ => drop(schema.insert("anyOf".to_owned(), Value::Array(variants))),
        }
    }
    transform_subschemas(&mut without_null, schema);
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use serde_json::Value;

    /// Set to have the published schema written anew instead of compared.
    const UPDATE: &str = "MARTI_UPDATE";

    #[test]
    fn the_published_schema_is_that_of_the_code() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/topology.schema.json");
        let schema = super::json().expect("is JSON");
        if std::env::var_os(UPDATE).is_some() {
            fs::write(&path, &schema).expect("can be written");
        }
        let published = fs::read_to_string(&path).unwrap_or_default();
        assert!(published == schema, "docs/topology.schema.json is out of date: run the tests with {UPDATE}=1");
    }

    #[test]
    fn every_key_is_documented() {
        let schema: Value = serde_json::from_str(&super::json().expect("is JSON")).expect("is JSON");
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/topology.md");
        let manual = fs::read_to_string(path).expect("docs/topology.md");
        let mut keys = Vec::new();
        collect_keys(&schema, &schema, "", &mut keys);
        assert!(keys.contains(&"cluster.local_memory.size".to_owned()), "{keys:?}");
        let missing: Vec<_> = keys.iter().filter(|key| !manual.contains(&format!("`{key}`"))).collect();
        assert!(missing.is_empty(), "docs/topology.md says nothing of {missing:?}");
    }

    /// The dotted names of all keys that hold a value, below `schema`.
    fn collect_keys(root: &Value, schema: &Value, prefix: &str, keys: &mut Vec<String>) {
        for part in [schema, &schema["items"]] {
            let name = part["$ref"].as_str().and_then(|reference| reference.rsplit('/').next());
            let definition = name.map_or(part, |name| &root["$defs"][name]);
            for (key, value) in definition["properties"].as_object().into_iter().flatten() {
                let key = format!("{prefix}{key}");
                let before = keys.len();
                collect_keys(root, value, &format!("{key}."), keys);
                if keys.len() == before {
                    keys.push(key);
                }
            }
        }
    }
}
