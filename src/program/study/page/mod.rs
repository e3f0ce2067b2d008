//! One HTML file with all in it: nothing to fetch, readable without its script.

pub mod charts;
pub mod grid;
pub mod plot;
pub mod table;

use std::fmt::{self, Display, Write};

use crate::study::page::grid::Grid;
use crate::study::page::plot::Chart;

/// A chart, and what it was made with.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub chart: Chart,
    /// Settings, and what is to be known to read it.
    pub caption: String,
}

/// How a study can be repeated.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Provenance {
    pub command: String,
    pub version: String,
    /// Of the study, in UTC.
    pub date: String,
    pub host: String,
    pub processor: String,
}

/// A table and its heading.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    pub heading: String,
    pub introduction: String,
    pub grid: Grid,
}

/// Tables that come first, figures, tables that come last, then the study as text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    pub title: String,
    pub introduction: String,
    pub first: Vec<Section>,
    pub figures: Vec<Figure>,
    pub last: Vec<Section>,
    /// Words and what they mean.
    pub definitions: Vec<(&'static str, String)>,
    /// Empty where the tables have everything.
    pub text: String,
}

const STYLE: &str = include_str!("study.css");
const SCRIPT: &str = include_str!("study.js");

impl Page {
    /// The file.
    pub fn html(&self, provenance: &Provenance) -> String {
        let mut html = String::new();
        // Writing to a string cannot fail.
        let _ = self.write(&mut html, provenance);
        html
    }

    fn write(&self, out: &mut String, provenance: &Provenance) -> fmt::Result {
        let title = Escaped(&self.title);
        writeln!(out, "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">")?;
        writeln!(out, "<meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>")?;
        writeln!(out, "<style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>")?;
        writeln!(out, "<p>{}</p>", Escaped(&self.introduction))?;
        provenance.write(out)?;
        writeln!(
            out,
            "<p>The numbers for programs: <a href=\"study.csv\">study.csv</a>, <a href=\"study.json\">study.json</a>.</p>"
        )?;
        self.first.iter().try_for_each(|section| section.write(out))?;
        if !self.figures.is_empty() {
            writeln!(
                out,
                "<h2>Charts</h2>\n<p>A point shows its values under the mouse. By keyboard: Tab enters a chart, the arrow keys left \
                 and right follow a series, up and down change it. The entries of a legend switch series on and off.</p>"
            )?;
        }
        writeln!(out, "<div class=\"figures\">")?;
        for Figure { chart, caption } in &self.figures {
            writeln!(out, "<figure>\n{}", chart.svg())?;
            writeln!(out, "<figcaption>{}</figcaption>\n</figure>", Escaped(caption))?;
        }
        writeln!(out, "</div>")?;
        self.last.iter().try_for_each(|section| section.write(out))?;
        if !self.definitions.is_empty() {
            writeln!(out, "<h2>Words</h2>\n<dl>")?;
            for (word, meaning) in &self.definitions {
                writeln!(out, "<dt><b>{}</b></dt><dd>{}</dd>", Escaped(word), Escaped(meaning))?;
            }
            writeln!(out, "</dl>")?;
        }
        if !self.text.is_empty() {
            writeln!(
                out,
                "<h2>As it is printed</h2>\n<div class=\"box\" tabindex=\"0\" role=\"region\" aria-label=\"As it is printed\">\
                 <pre>{}</pre></div>",
                Escaped(&self.text)
            )?;
        }
        writeln!(out, "<div id=\"value\" role=\"status\" aria-live=\"polite\"></div>")?;
        writeln!(out, "<script>\n{SCRIPT}</script>\n</body>\n</html>")
    }
}

impl Provenance {
    fn write(&self, out: &mut String) -> fmt::Result {
        writeln!(out, "<dl class=\"about\">")?;
        let Self { command, version, date, host, processor } = self;
        writeln!(out, "<dt>command</dt><dd><code>{}</code></dd>", Escaped(command))?;
        for (name, text) in [("version", version), ("date", date), ("host", host), ("processor", processor)] {
            writeln!(out, "<dt>{name}</dt><dd>{}</dd>", Escaped(text))?;
        }
        writeln!(out, "</dl>")
    }
}

impl Section {
    fn write(&self, out: &mut String) -> fmt::Result {
        let heading = Escaped(&self.heading);
        writeln!(out, "<h2>{heading}</h2>\n<p>{}</p>", Escaped(&self.introduction))?;
        writeln!(
            out,
            "<div class=\"box\" tabindex=\"0\" role=\"region\" aria-label=\"{heading}\">\n{}</div>",
            self.grid
        )
    }
}

/// Text as HTML shows it, also between quotes.
pub(super) struct Escaped<'a>(pub(super) &'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|c| match c {
            '&' => out.write_str("&amp;"),
            '<' => out.write_str("&lt;"),
            '>' => out.write_str("&gt;"),
            '"' => out.write_str("&quot;"),
            c => out.write_char(c),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::page::grid::Cell;
    use crate::study::page::plot::{Axis, Series, Style};

    #[test]
    fn a_page_is_whole_in_itself_and_escapes_its_texts() {
        let axis = |label| Axis::from_zero(label, 3.0);
        let series = |name: &str, style| Series { name: name.to_owned(), points: vec![(0.5, 1.0), (2.0, 3.0)], style };
        let styles = [Style::Line, Style::Marked, Style::Dashed, Style::Published];
        let chart = Chart {
            title: "a < b".to_owned(),
            x: axis("x"),
            y: axis("y"),
            series: styles.map(|style| series("4 & 9", style)).to_vec(),
        };
        let grid = Grid { columns: vec!["<c>".to_owned()], rows: vec![vec![Cell::words("\"q\"")]] };
        let page = Page {
            title: "T<1>".to_owned(),
            introduction: "<img>".to_owned(),
            figures: vec![Figure { chart, caption: "p & q".to_owned() }],
            last: vec![Section { heading: "S".to_owned(), introduction: String::new(), grid }],
            text: "1 > 0".to_owned(),
            ..Page::default()
        };
        let html = page.html(&Provenance { command: "marti '<x>'".to_owned(), ..Provenance::default() });
        for expected in [
            "T&lt;1&gt;",
            "p &amp; q",
            "1 &gt; 0",
            "a &lt; b",
            "4 &amp; 9",
            "<polyline",
            "'&lt;x&gt;'",
            "&lt;c&gt;",
            "&quot;q&quot;",
        ] {
            assert!(html.contains(expected), "{expected}: {html}");
        }
        for never in ["<img", " src=", "@import", "url(", "https:"] {
            assert!(!html.contains(never), "{never}");
        }
        let links: Vec<_> = html.split("href=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        assert_eq!(links, ["study.csv", "study.json"]);
    }
}
