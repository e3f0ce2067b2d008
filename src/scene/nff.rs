//! stub
use super::{Scene, SourceError};
use std::path::Path;
pub fn load(_path: &Path) -> Result<Scene, SourceError> {
    unimplemented!()
}
