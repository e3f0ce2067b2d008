//! From a scene to an image: scenes, the database with its octree, and the tracer with its two kernels. Pure but for the files of
//! scenes and images.

pub mod database;
pub mod image_file;
pub mod oracle;
pub mod picture;
pub mod preparation;
pub mod render;
pub mod scene;
pub mod tracer;
