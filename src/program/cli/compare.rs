//! `marti compare A B`

use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use serde_json::Value;

use super::options::TextOrJson;
use super::{Exit, Failure, output_path, print};
use cluster::report;
use cluster::topology::Topology;
use trace::image_file::{Comparison, Picture};

/// Compare two runs, pictures or reports: by how much the pixels differ, and which settings and counts
#[derive(Clone, Debug, Args)]
pub struct CompareArguments {
    /// Output folder of a run, a .png file, or a report in a .json file
    a: PathBuf,
    /// What it is compared with, of the same kind
    b: PathBuf,
    /// Write a picture of the differences: black where the pixels are the same, the largest difference as full brightness
    #[arg(short, long, value_name = "FILE.png")]
    out: Option<PathBuf>,
    /// How the result is printed
    #[arg(long, value_enum, default_value_t = TextOrJson::Text)]
    format: TextOrJson,
    /// Exit with 1 if pixels, settings or counts differ
    #[arg(long)]
    exit_code: bool,
}

pub(super) fn compare(arguments: &CompareArguments) -> Result<(), Failure> {
    let (a, b) = (Subject::find(&arguments.a)?, Subject::find(&arguments.b)?);
    let compared = Compared::of(&a, &b, arguments.out.as_deref())?;
    print(&match arguments.format {
        TextOrJson::Text => compared.to_string(),
        TextOrJson::Json => super::json(&compared)?,
    })?;
    match arguments.exit_code && !compared.is_same() {
        true => Err(Failure::new(Exit::Failed, format!("{} and {} differ", a.name, b.name))),
        false => Ok(()),
    }
}

/// The files of one side.
struct Subject {
    name: String,
    picture: Option<PathBuf>,
    report: Option<PathBuf>,
    topology: Option<PathBuf>,
}

impl Subject {
    fn find(path: &Path) -> Result<Self, Failure> {
        let name = path.display().to_string();
        let there = |path: PathBuf| path.is_file().then_some(path);
        if path.is_dir() {
            let [picture, report, topology] =
                ["image.png", "report.json", "topology.toml"].map(|name| there(path.join(name)));
            if picture.is_none() && report.is_none() {
                return Err(Failure::bad_input(format!(
                    "{name}: neither image.png nor report.json, expected the output folder of a run"
                )));
            }
            return Ok(Self { name, picture, report, topology });
        }
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let file = Some(path.to_owned());
        match extension.to_str() {
            Some("png") => Ok(Self { name, picture: file, report: None, topology: None }),
            Some("json") => Ok(Self { name, picture: None, report: file, topology: None }),
            _ => Err(Failure::bad_input(format!(
                "{name}: expected the output folder of a run, or a file in .png or .json"
            ))),
        }
    }
}

/// What was compared. A part that a side lacks is absent.
#[derive(Debug, Serialize)]
struct Compared {
    a: String,
    b: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    picture: Option<Comparison>,
    #[serde(skip_serializing_if = "Option::is_none")]
    settings: Option<Vec<Difference>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    counts: Option<Vec<Difference>>,
    /// They vary from run to run.
    #[serde(skip_serializing_if = "Option::is_none")]
    times: Option<Vec<Difference>>,
}

/// A value that is not the same on both sides; `None` where a side lacks it.
#[derive(Debug, Serialize)]
struct Difference {
    key: String,
    a: Option<Value>,
    b: Option<Value>,
    /// `b / a`, of numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    ratio: Option<f64>,
}

impl Compared {
    fn of(a: &Subject, b: &Subject, differences: Option<&Path>) -> Result<Self, Failure> {
        let picture = match (&a.picture, &b.picture) {
            (Some(a), Some(b)) => Some(compare_pictures(a, b, differences)?),
            _ if differences.is_some() => {
                return Err(Failure::bad_input("--out has no effect: a picture is missing, expected two"));
            }
            _ => None,
        };
        let settings = match (&a.topology, &b.topology) {
            (Some(a), Some(b)) => Some(differing(&settings(a)?, &settings(b)?)),
            _ => None,
        };
        let (counts, times) = match (&a.report, &b.report) {
            (Some(a), Some(b)) => {
                let (times, counts) = differing(&leaves(a)?, &leaves(b)?).into_iter().partition(Difference::is_time);
                (Some(counts), Some(times))
            }
            _ => (None, None),
        };
        if picture.is_none() && counts.is_none() {
            let what = format!(
                "{} and {}: nothing of the same kind, expected two folders, pictures or reports",
                a.name, b.name
            );
            return Err(Failure::bad_input(what));
        }
        Ok(Self { a: a.name.clone(), b: b.name.clone(), picture, settings, counts, times })
    }

    fn is_same(&self) -> bool {
        let is_empty = |differences: &Option<Vec<Difference>>| differences.as_ref().is_none_or(Vec::is_empty);
        self.picture.as_ref().is_none_or(Comparison::is_same) && is_empty(&self.settings) && is_empty(&self.counts)
    }
}

fn compare_pictures(a: &Path, b: &Path, differences: Option<&Path>) -> Result<Comparison, Failure> {
    if let Some(path) = differences {
        output_path::check(path)?;
        output_path::check_apart(&[("--out", path)], &[a, b])?;
    }
    let read = |path: &Path| Picture::read(path).map_err(|error| Failure::bad_input(error.to_string()));
    let [first, second] = [read(a)?, read(b)?];
    let found = Comparison::of(&first, &second)
        .map_err(|error| Failure::bad_input(format!("{}, {}: {error}", a.display(), b.display())))?;
    if let Some(path) = differences {
        found.write_differences(&first, &second, path).map_err(|error| Failure::failed(error.to_string()))?;
    }
    Ok(found)
}

type Leaves = BTreeMap<String, Value>;

fn settings(path: &Path) -> Result<Leaves, Failure> {
    let topology = Topology::read(path, &[])?;
    let settings = topology.settings().map_err(|error| Failure::failed(error.to_string()))?;
    Ok(settings.into_iter().map(|(key, value)| (key, Value::String(value))).collect())
}

/// The values of a report by their place in it.
fn leaves(path: &Path) -> Result<Leaves, Failure> {
    let report = report::json::read(path).map_err(|error| Failure::bad_input(error.to_string()))?;
    let report = serde_json::to_value(report).map_err(|error| Failure::failed(error.to_string()))?;
    let mut leaves = Leaves::new();
    collect(String::new(), report, &mut leaves);
    Ok(leaves)
}

fn collect(key: String, value: Value, leaves: &mut Leaves) {
    let within = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        Value::Object(fields) => fields.into_iter().for_each(|(name, value)| collect(within(&name), value, leaves)),
        Value::Array(values) => {
            values.into_iter().enumerate().for_each(|(i, value)| collect(within(&i.to_string()), value, leaves));
        }
        value => {
            leaves.insert(key, value);
        }
    }
}

fn differing(a: &Leaves, b: &Leaves) -> Vec<Difference> {
    let keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
    let mut differences: Vec<_> =
        keys.filter(|key| a.get(*key) != b.get(*key)).map(|key| Difference::new(key, a, b)).collect();
    differences.sort_by(|a, b| a.key.cmp(&b.key));
    differences
}

impl Difference {
    fn new(key: &str, a: &Leaves, b: &Leaves) -> Self {
        let (a, b) = (a.get(key), b.get(key));
        let number = |value: Option<&Value>| value.and_then(Value::as_f64);
        let ratio = number(a).zip(number(b)).filter(|&(a, _)| a != 0.0).map(|(a, b)| b / a);
        Self { key: key.to_owned(), a: a.cloned(), b: b.cloned(), ratio }
    }

    fn is_time(&self) -> bool {
        ["seconds", "per_second"].iter().any(|time| self.key.contains(time))
    }

    /// Whether it is of one of many: a node, a tile, a level.
    fn is_of_a_list(&self) -> bool {
        self.key.split('.').any(|part| part.bytes().all(|byte| byte.is_ascii_digit()))
    }
}

impl Display for Compared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "a  {}\nb  {}", self.a, self.b)?;
        match &self.picture {
            None => {}
            Some(found) if found.is_same() => {
                writeln!(f, "\npicture: the same {}x{} pixels", found.width, found.height)?
            }
            Some(found) => {
                let pixels = u64::from(found.width) * u64::from(found.height);
                let share = 100.0 * found.differing_pixels as f64 / pixels as f64;
                writeln!(f, "\npicture: {} of {pixels} pixels differ ({share:.2}%)", found.differing_pixels)?;
                write!(f, "  RMSE {:.4} of 255", found.rmse)?;
                if let Some(psnr) = found.psnr_decibels {
                    write!(f, ", PSNR {psnr:.2} dB")?;
                }
                if let Some([x, y]) = found.largest_at {
                    write!(f, ", largest error {} of 255 at column {x}, row {y}", found.largest_error)?;
                }
                writeln!(f)?;
            }
        }
        let parts = [
            ("settings", &self.settings),
            ("counts", &self.counts),
            ("times, which vary from run to run", &self.times),
        ];
        for (name, differences) in parts {
            if let Some(differences) = differences {
                write_part(f, name, differences)?;
            }
        }
        Ok(())
    }
}

fn write_part(f: &mut fmt::Formatter<'_>, name: &str, differences: &[Difference]) -> fmt::Result {
    if differences.is_empty() {
        return writeln!(f, "\n{name}: the same");
    }
    let (listed, shown): (Vec<_>, Vec<_>) = differences.iter().partition(|difference| difference.is_of_a_list());
    writeln!(f, "\n{name}: {} differ", differences.len())?;
    if !shown.is_empty() {
        writeln!(f, "  {:<42} {:>20} {:>20} {:>10}", "", "a", "b", "b/a")?;
    }
    for Difference { key, a, b, ratio } in shown {
        let ratio = ratio.map_or_else(String::new, |ratio| format!("{ratio:.4}"));
        let line = format!("  {key:<42} {:>20} {:>20} {ratio:>10}", text(a.as_ref()), text(b.as_ref()));
        writeln!(f, "{}", line.trim_end())?;
    }
    if !listed.is_empty() {
        writeln!(f, "  and {} of single nodes, clusters, levels and the like: --format json lists them", listed.len())?;
    }
    Ok(())
}

/// At most as wide as its column.
fn text(value: Option<&Value>) -> String {
    const CHARACTERS_MAX: usize = 20;
    let text = match value {
        None => "-".to_owned(),
        Some(Value::Number(number)) if number.is_f64() => format!("{:.6}", number.as_f64().unwrap_or_default()),
        Some(Value::String(text)) => text.clone(),
        Some(value) => value.to_string(),
    };
    if text.chars().count() <= CHARACTERS_MAX {
        return text;
    }
    text.chars().take(CHARACTERS_MAX - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leaves_of(json: &str) -> Leaves {
        let mut leaves = Leaves::new();
        collect(String::new(), serde_json::from_str(json).expect("JSON"), &mut leaves);
        leaves
    }

    #[test]
    fn differences_are_by_key_with_ratios_and_times_apart() {
        let a = leaves_of(r#"{"bus":{"fetches":10,"rows":3},"seconds":{"total":2.0},"nodes":[{"tiles":4}]}"#);
        let b =
            leaves_of(r#"{"bus":{"fetches":15,"rows":3},"seconds":{"total":1.0},"nodes":[{"tiles":3},{"tiles":1}]}"#);
        let found = differing(&a, &b);
        let keys: Vec<_> = found.iter().map(|difference| difference.key.as_str()).collect();
        assert_eq!(keys, ["bus.fetches", "nodes.0.tiles", "nodes.1.tiles", "seconds.total"]);
        assert_eq!(
            found.iter().map(|difference| difference.ratio).collect::<Vec<_>>(),
            [Some(1.5), Some(0.75), None, Some(0.5)]
        );
        assert_eq!(found.iter().map(Difference::is_time).collect::<Vec<_>>(), [false, false, false, true]);
        assert_eq!(found.iter().map(Difference::is_of_a_list).collect::<Vec<_>>(), [false, true, true, false]);
        assert!(differing(&a, &a).is_empty());
    }
}
