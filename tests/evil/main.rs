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
