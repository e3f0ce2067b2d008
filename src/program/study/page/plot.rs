//! Line charts as SVG: legible by themselves; the page's style sheet gives them its colours, its script their values on hover.

use std::fmt::{self, Write};

use crate::study::page::Escaped;

/// Distinct to the colour-blind: M. Okabe, K. Ito, *Color Universal Design*, 2008, and a brown.
const COLOURS: [&str; SHOWN_MAX] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b07d00", "#56b4e9", "#5a5a5a", "#8c510a"];
/// More curves in one chart cannot be distinguished: the others are there, but switched off.
const SHOWN_MAX: usize = 8;
/// Small, so that text is large enough where the chart is as wide as a telephone.
const WIDTH: f64 = 480.0;
const PLOT: Area = Area { left: 64.0, right: 462.0, top: 44.0, bottom: 262.0 };
/// From the plot to its legend: ticks and the axis' label.
const BELOW: f64 = 52.0;
const LEGEND_LINE: f64 = 20.0;
/// Longer names are cut in the legend; points have the whole name.
const NAME_MAX: usize = 56;
/// Wider titles go on in a second line.
const TITLE_MAX: usize = 54;

struct Area {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

/// What a chart shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub series: Vec<Series>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    pub label: String,
    pub range: (f64, f64),
    /// Where it is labelled, and how.
    pub ticks: Vec<(f64, String)>,
    pub logarithmic: bool,
}

/// One line of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    pub name: String,
    pub points: Vec<(f64, f64)>,
    pub style: Style,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    Line,
    /// Straight lines between points that are marked.
    Marked,
    /// Marked and dashed.
    Dashed,
    /// Published elsewhere: crosses that nothing connects.
    Published,
}

impl Axis {
    pub fn linear(label: &str, range: (f64, f64), ticks: Vec<(f64, String)>) -> Self {
        Self { label: label.to_owned(), range, ticks, logarithmic: false }
    }

    /// The range is above 0.
    pub fn logarithmic(label: &str, range: (f64, f64), ticks: Vec<(f64, String)>) -> Self {
        Self { label: label.to_owned(), range, ticks, logarithmic: true }
    }

    /// Linear from 0 to above `most`, with round ticks.
    pub fn from_zero(label: &str, most: f64) -> Self {
        Self::round(label, 0.0, if most > 0.0 { most } else { 1.0 })
    }

    /// Linear around the values, and from 0 unless that would press them together at the top.
    pub fn fitting(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let (least, most) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), y| (least.min(y), most.max(y)));
        if least > 0.5 * most && most > least { Self::round(label, least, most) } else { Self::from_zero(label, most) }
    }

    /// Four to ten ticks at round numbers, the outermost at `least` and `most` or beyond.
    fn round(label: &str, least: f64, most: f64) -> Self {
        let extent = most - least;
        let decade = libm::pow(10.0, libm::floor(libm::log10(extent)));
        let step = [0.1, 0.2, 0.5, 1.0].map(|part| part * decade).into_iter().find(|step| extent / step <= 8.0);
        let step = step.unwrap_or(2.0 * decade);
        // What rounding adds to a multiple of the step makes no step of its own.
        const ROUNDING: f64 = 1e-9;
        let first = libm::floor(least / step + ROUNDING);
        let steps = (libm::ceil(most / step - ROUNDING) - first).max(1.0) as u32;
        let decimals = (-libm::floor(libm::log10(step) + ROUNDING)).max(0.0) as usize;
        let at = |i: u32| (first + f64::from(i)) * step;
        let ticks = (0..=steps).map(|i| (at(i), format!("{:.decimals$}", at(i)))).collect();
        Self::linear(label, (at(0), at(steps)), ticks)
    }

    fn share(&self, value: f64) -> f64 {
        let place = |value: f64| if self.logarithmic { libm::log2(value) } else { value };
        let (first, last) = (place(self.range.0), place(self.range.1));
        (place(value) - first) / (last - first)
    }

    /// How a value is read out: as the tick there, if there is one.
    fn named(&self, value: f64) -> String {
        self.ticks.iter().find(|(at, _)| *at == value).map_or_else(|| number(value), |(_, label)| label.clone())
    }
}

/// To six significant digits.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (5.0 - libm::floor(libm::log10(value.abs()))).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

impl Chart {
    /// An `svg` element.
    pub fn svg(&self) -> String {
        let mut svg = String::new();
        // Writing to a string cannot fail.
        let _ = self.draw(&mut svg);
        svg
    }

    fn draw(&self, out: &mut String) -> fmt::Result {
        let legend = PLOT.bottom + BELOW;
        let height = legend + LEGEND_LINE * self.series.len() as f64;
        let title = Escaped(&self.title);
        write!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
             font-size=\"13\" role=\"group\" aria-label=\"{title}\">\n\
             <rect class=\"ground\" width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n"
        )?;
        let lines = wrapped(&self.title, TITLE_MAX);
        let top = if lines.len() > 1 { 17.0 } else { 26.0 };
        for (i, line) in lines.iter().enumerate() {
            let y = top + 17.0 * i as f64;
            text(out, (WIDTH / 2.0, y), "middle", " font-size=\"15\" font-weight=\"bold\"", line)?;
        }
        self.axes(out)?;
        for (i, series) in self.series.iter().enumerate() {
            self.series(out, i, series)?;
            let y = legend + LEGEND_LINE * i as f64;
            write!(out, "<g class=\"key {}\" data-series=\"{i}\" color=\"{}\">", class(i, series), colour(i, series))?;
            // All of the line is there to be clicked.
            write!(
                out,
                "<rect x=\"0\" y=\"{}\" width=\"{WIDTH}\" height=\"{LEGEND_LINE}\" fill=\"none\" pointer-events=\"all\"/>",
                y - 10.0
            )?;
            if series.style == Style::Published {
                cross(out, 30.0, y)?;
            } else {
                write!(out, "<path d=\"M16 {y}H44\" stroke=\"currentColor\" stroke-width=\"2\"{}/>", dashes(series))?;
            }
            text(out, (52.0, y + 4.5), "start", "", &cut(&series.name))?;
            out.write_str("</g>\n")?;
        }
        out.write_str("</svg>")
    }

    fn axes(&self, out: &mut String) -> fmt::Result {
        let Area { left, right, top, bottom } = PLOT;
        let mut free_from = f64::NEG_INFINITY;
        for (value, label) in &self.x.ticks {
            let x = self.at_x(*value);
            line(out, "grid", "#ddd", (x, top), (x, bottom))?;
            let half = 3.8 * label.chars().count() as f64;
            if x - half > free_from {
                text(out, (x, bottom + 18.0), "middle", "", label)?;
                free_from = x + half + 4.0;
            }
        }
        for (value, label) in &self.y.ticks {
            let y = self.at_y(*value);
            line(out, "grid", "#ddd", (left, y), (right, y))?;
            text(out, (left - 6.0, y + 4.5), "end", "", label)?;
        }
        line(out, "axis", "#555", (left, bottom), (right, bottom))?;
        line(out, "axis", "#555", (left, top), (left, bottom))?;
        text(out, (f64::midpoint(left, right), bottom + 36.0), "middle", "", &self.x.label)?;
        let middle = f64::midpoint(top, bottom);
        let turned = format!(" transform=\"rotate(-90 14 {middle})\"");
        text(out, (14.0, middle), "middle", &turned, &self.y.label)
    }

    fn series(&self, out: &mut String, i: usize, series: &Series) -> fmt::Result {
        let off = if i < SHOWN_MAX { "" } else { " off" };
        let (class, colour) = (class(i, series), colour(i, series));
        writeln!(out, "<g class=\"series {class}{off}\" data-series=\"{i}\" color=\"{colour}\">")?;
        if series.style != Style::Published {
            let points: Vec<_> =
                series.points.iter().map(|&(x, y)| format!("{:.1},{:.1}", self.at_x(x), self.at_y(y))).collect();
            writeln!(
                out,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"currentColor\" stroke-width=\"2\"{}/>",
                points.join(" "),
                dashes(series)
            )?;
        }
        for &(x, y) in &series.points {
            let at = (self.at_x(x), self.at_y(y));
            if series.style == Style::Published {
                cross(out, at.0, at.1)?;
            }
            // A point of a mere line is there to be pointed at, and seen only then.
            let (radius, unseen) = match series.style {
                Style::Line => (5, " opacity=\"0\""),
                Style::Published => (6, " opacity=\"0\""),
                Style::Marked | Style::Dashed => (4, ""),
            };
            writeln!(
                out,
                "<circle class=\"point\" role=\"img\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\" fill=\"currentColor\"{unseen} \
                 data-x=\"{x}\" data-y=\"{y}\"><title>{}</title></circle>",
                at.0,
                at.1,
                Escaped(&format!(
                    "{}: {} {}, {} {}",
                    series.name,
                    self.x.label,
                    self.x.named(x),
                    number(y),
                    self.y.label
                ))
            )?;
        }
        out.write_str("</g>\n")
    }

    fn at_x(&self, value: f64) -> f64 {
        PLOT.left + (PLOT.right - PLOT.left) * self.x.share(value)
    }

    fn at_y(&self, value: f64) -> f64 {
        PLOT.bottom - (PLOT.bottom - PLOT.top) * self.y.share(value)
    }
}

fn class(i: usize, series: &Series) -> String {
    if series.style == Style::Published { "published".to_owned() } else { format!("c{}", i % COLOURS.len()) }
}

fn colour(i: usize, series: &Series) -> &'static str {
    if series.style == Style::Published { "#000" } else { COLOURS[i % COLOURS.len()] }
}

fn dashes(series: &Series) -> &'static str {
    if series.style == Style::Dashed { " stroke-dasharray=\"6 4\"" } else { "" }
}

fn text(out: &mut String, (x, y): (f64, f64), anchor: &str, more: &str, text: &str) -> fmt::Result {
    writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{more}>{}</text>", Escaped(text))
}

fn line(out: &mut String, class: &str, colour: &str, from: (f64, f64), to: (f64, f64)) -> fmt::Result {
    let ((x1, y1), (x2, y2)) = (from, to);
    writeln!(out, "<path class=\"{class}\" d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{colour}\"/>")
}

fn cross(out: &mut String, x: f64, y: f64) -> fmt::Result {
    let (left, right, top, bottom) = (x - 5.0, x + 5.0, y - 5.0, y + 5.0);
    write!(
        out,
        "<path d=\"M{left:.1} {top:.1}L{right:.1} {bottom:.1}M{right:.1} {top:.1}L{left:.1} {bottom:.1}\" \
         stroke=\"currentColor\" stroke-width=\"2\"/>"
    )
}

fn cut(name: &str) -> String {
    if name.chars().count() <= NAME_MAX {
        return name.to_owned();
    }
    name.chars().take(NAME_MAX - 1).chain(['…']).collect()
}

/// Lines of at most so many characters, between words.
fn wrapped(text: &str, most: usize) -> Vec<String> {
    let mut lines: Vec<String> = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.last_mut().expect("there is always one");
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= most {
            *line += " ";
            *line += word;
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, label)| label.as_str()).collect()
    }

    #[test]
    fn axes_end_at_round_numbers() {
        for (most, expected) in [
            (33.3, &["0", "5", "10", "15", "20", "25", "30", "35"][..]),
            (0.0581, &["0.00", "0.01", "0.02", "0.03", "0.04", "0.05", "0.06"]),
            (1.0, &["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
            (0.0, &["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        ] {
            assert_eq!(ticks(&Axis::from_zero("y", most)), expected, "{most}");
        }
        assert_eq!(ticks(&Axis::fitting("y", [98.2, 99.7].into_iter()))[..2], ["98.2", "98.4"]);
        assert_eq!(Axis::fitting("y", [3.0, 7.0].into_iter()).range, (0.0, 7.0), "0 is not far");
        assert_eq!(Axis::fitting("y", [5.0, 5.0].into_iter()).range.0, 0.0, "one value alone");
    }

    #[test]
    fn a_logarithmic_axis_has_octaves_of_the_same_length() {
        let axis = Axis::logarithmic("x", (1.0, 64.0), Vec::new());
        let places = [1.0, 2.0, 8.0, 64.0].map(|value| (600.0 * axis.share(value)).round());
        assert_eq!(places, [0.0, 100.0, 300.0, 600.0]);
        assert_eq!(Axis::linear("x", (0.0, 10.0), Vec::new()).share(5.0), 0.5);
    }

    #[test]
    fn more_series_than_can_be_distinguished_are_switched_off() {
        let series = |i: usize| Series { name: i.to_string(), points: vec![(1.0, 2.0)], style: Style::Marked };
        let (x, y) = (Axis::from_zero("x", 2.0), Axis::from_zero("y", 2.0));
        let svg = Chart { title: "t".to_owned(), x, y, series: (0..SHOWN_MAX + 2).map(series).collect() }.svg();
        assert_eq!((svg.matches(" off\"").count(), svg.matches("class=\"key").count()), (2, SHOWN_MAX + 2));
        assert!(svg.contains("<title>9: x 1.0, 2 y</title>"), "{svg}");
    }

    #[test]
    fn numbers_have_six_digits() {
        let of = [0.014004733383, 74836882.0, 0.5, 0.0, 98.44246769].map(number);
        assert_eq!(of, ["0.0140047", "74836882", "0.5", "0", "98.4425"]);
    }
}
