//! Studies: scenes traced once (`runs`), then replayed through many clusters (`figures`), as text and as one page of charts
//! (`page`). [`paper`] is what the paper publishes (`published`) beside what this program finds; [`sweep`] the same for a
//! scene of one's own.

pub mod figures;
pub mod page;
pub mod paper;
pub mod published;
pub mod runs;
pub mod sweep;
pub mod varied;
