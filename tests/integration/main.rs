//! The real binaries, from the outside.

mod bad_input;
mod chaos;
mod command;
mod command_line;
mod damaged_recordings;
mod effect;
mod examples;
mod exports;
mod faults;
mod floating_point;
mod frames;
mod hosts;
mod imports;
mod libcachesim;
mod limits;
mod output;
mod play;
mod preload;
mod processes;
mod recording;
mod reference;
mod references;
mod resume;
mod same_image;
mod view;
mod warnings;
