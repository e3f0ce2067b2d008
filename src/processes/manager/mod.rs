//! stub
mod ending;
mod job_queue;
mod ledger;
mod plan;
mod process;
mod process_table;
mod state;
mod tile_order;

#[cfg(test)]
mod sample;
#[cfg(test)]
mod state_tests;
