//! Line charts as SVG.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::element::DashedPathElement;
use plotters::prelude::*;

/// Distinct to the colour-blind: M. Okabe, K. Ito, *Color Universal Design*, 2008.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(90, 90, 90),
];
const SIZE: (u32, u32) = (720, 400);

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
    /// What somebody else publishes: black crosses that nothing connects.
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

    /// Linear from 0 to above `most`, with four to ten ticks at round numbers.
    pub fn from_zero(label: &str, most: f64) -> Self {
        let most = if most > 0.0 { most } else { 1.0 };
        let decade = libm::pow(10.0, libm::floor(libm::log10(most)));
        let step = [0.1, 0.2, 0.5, 1.0].map(|part| part * decade).into_iter().find(|step| most / step <= 8.0);
        let step = step.unwrap_or(2.0 * decade);
        let steps = libm::ceil(most / step) as u32;
        let decimals = (-libm::floor(libm::log10(step))).max(0.0) as usize;
        let tick = |i: u32| (f64::from(i) * step, format!("{:.decimals$}", f64::from(i) * step));
        Self::linear(label, (0.0, f64::from(steps) * step), (0..=steps).map(tick).collect())
    }

    fn share(&self, value: f64) -> f64 {
        let place = |value: f64| if self.logarithmic { libm::log2(value) } else { value };
        let (first, last) = (place(self.range.0), place(self.range.1));
        (place(value) - first) / (last - first)
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (first, last): (i32, i32)) -> i32 {
        first + (f64::from(last - first) * self.share(*value)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.iter().map(|(value, _)| *value).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        self.range.0..self.range.1
    }
}

impl ValueFormatter<f64> for Axis {
    fn format(value: &f64) -> String {
        value.to_string()
    }

    fn format_ext(&self, value: &f64) -> String {
        self.ticks.iter().find(|(at, _)| at == value).map_or_else(String::new, |(_, label)| label.clone())
    }
}

impl Chart {
    /// An `svg` element.
    pub fn svg(&self) -> String {
        let mut svg = String::new();
        // Drawing into a string cannot fail.
        let _ = self.draw(&SVGBackend::with_string(&mut svg, SIZE).into_drawing_area());
        svg
    }

    fn draw(
        &self,
        area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    ) -> Result<(), Box<dyn std::error::Error>> {
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 17))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(62)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        chart
            .configure_mesh()
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .bold_line_style(RGBColor(222, 222, 222))
            .light_line_style(TRANSPARENT)
            .axis_style(RGBColor(90, 90, 90))
            .label_style(("sans-serif", 13))
            .draw()?;
        for (i, series) in self.series.iter().enumerate() {
            let colour = if series.style == Style::Published { BLACK } else { COLOURS[i % COLOURS.len()] };
            let line = colour.stroke_width(2);
            let points = series.points.iter().copied();
            let mark = move |at| Circle::new(at, 3, colour.filled());
            let drawn = match series.style {
                Style::Published => chart.draw_series(points.map(|at| Cross::new(at, 5, line)))?,
                Style::Dashed => {
                    chart.draw_series(points.clone().map(mark))?;
                    chart.draw_series(DashedLineSeries::new(points, 6, 4, line))?
                }
                Style::Line | Style::Marked => {
                    if series.style == Style::Marked {
                        chart.draw_series(points.clone().map(mark))?;
                    }
                    chart.draw_series(LineSeries::new(points, line))?
                }
            };
            let style = series.style;
            drawn.label(&series.name).legend(move |(x, y)| match style {
                Style::Published => Cross::new((x + 10, y), 5, line).into_dyn(),
                Style::Dashed => DashedPathElement::new([(x, y), (x + 20, y)], 6, 4, line).into_dyn(),
                Style::Line | Style::Marked => PathElement::new([(x, y), (x + 20, y)], line).into_dyn(),
            });
        }
        chart
            .configure_series_labels()
            .position(self.legend_at())
            .margin(8)
            .background_style(WHITE.mix(0.85))
            .border_style(RGBColor(200, 200, 200))
            .label_font(("sans-serif", 13))
            .draw()?;
        area.present()?;
        Ok(())
    }

    /// Where it hides the fewest points.
    fn legend_at(&self) -> SeriesLabelPosition {
        let height = 0.09 * self.series.len() as f64;
        let points: Vec<(f64, f64)> = self
            .series
            .iter()
            .flat_map(|series| &series.points)
            .map(|&(x, y)| (self.x.share(x), self.y.share(y)))
            .collect();
        let hidden = |&(_, left, lower): &(SeriesLabelPosition, f64, f64)| {
            let is_below =
                |&&(x, y): &&(f64, f64)| (left..=left + 0.5).contains(&x) && (lower..=lower + height).contains(&y);
            points.iter().filter(is_below).count()
        };
        let places = [
            (SeriesLabelPosition::UpperRight, 0.5, 1.0 - height),
            (SeriesLabelPosition::UpperLeft, 0.0, 1.0 - height),
            (SeriesLabelPosition::MiddleLeft, 0.0, 0.5 - height / 2.0),
            (SeriesLabelPosition::MiddleRight, 0.5, 0.5 - height / 2.0),
            (SeriesLabelPosition::LowerLeft, 0.0, 0.0),
            (SeriesLabelPosition::LowerRight, 0.5, 0.0),
        ];
        places.into_iter().min_by_key(hidden).map_or(SeriesLabelPosition::UpperRight, |(place, ..)| place)
    }
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
    }

    #[test]
    fn a_logarithmic_axis_has_octaves_of_the_same_length() {
        let axis = Axis::logarithmic("x", (1.0, 64.0), Vec::new());
        let places = [1.0, 2.0, 8.0, 64.0].map(|value| axis.map(&value, (0, 600)));
        assert_eq!(places, [0, 100, 300, 600]);
        assert_eq!(Axis::linear("x", (0.0, 10.0), Vec::new()).map(&5.0, (400, 0)), 200);
    }
}
