//! The JSON schema of a topology file, published as docs/topology.schema.json.

use super::file::File;

/// The schema as JSON text, ending in a newline.
///
/// # Errors
/// None is known: a schema is JSON.
pub fn json() -> Result<String, serde_json::Error> {
    serde_json::to_string_pretty(&schemars::schema_for!(File)).map(|text| text + "\n")
}
