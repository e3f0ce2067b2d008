//! One HTML file with all in it: no scripts, nothing to fetch.

pub mod charts;
pub mod plot;
pub mod table;

use std::fmt::{self, Display, Write};

use crate::study::page::plot::Chart;

/// A chart, and what it was made with.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub chart: Chart,
    /// Settings, and what is to be known to read it.
    pub caption: String,
}

/// Figures, then the study as text.
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    pub title: String,
    pub introduction: String,
    pub figures: Vec<Figure>,
    pub text: String,
}

const STYLE: &str = "\
body { font: 16px/1.5 sans-serif; color: #222; background: #fff; max-width: 1500px; margin: 2em auto; padding: 0 1em }
.figures { display: flex; flex-wrap: wrap; gap: 1.5em }
figure { margin: 0; width: 720px; max-width: 100% }
figure svg { width: 100%; height: auto; border: 1px solid #ddd }
figcaption { font-size: 14px; color: #444 }
pre { font: 13px/1.35 monospace; overflow-x: auto; background: #fafafa; border: 1px solid #ddd; padding: 1em }";

impl Display for Page {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let title = Escaped(&self.title);
        writeln!(out, "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">")?;
        writeln!(out, "<meta name=\"viewport\" content=\"width=device-width\">\n<title>{title}</title>")?;
        writeln!(out, "<style>\n{STYLE}\n</style>\n</head>\n<body>\n<h1>{title}</h1>")?;
        writeln!(out, "<p>{}</p>\n<div class=\"figures\">", Escaped(&self.introduction))?;
        for Figure { chart, caption } in &self.figures {
            writeln!(out, "<figure role=\"group\">\n{}", responsive(&chart.svg()))?;
            writeln!(out, "<figcaption>{}</figcaption>\n</figure>", Escaped(caption))?;
        }
        writeln!(out, "</div>\n<h2>All figures</h2>\n<pre>{}</pre>\n</body>\n</html>", Escaped(&self.text))
    }
}

/// Without its fixed size, so that it becomes as wide as there is room; its `viewBox` gives the proportions.
fn responsive(svg: &str) -> String {
    let (head, rest) = svg.split_once('>').unwrap_or((svg, ""));
    let head: Vec<&str> = head
        .split_inclusive(' ')
        .filter(|attribute| !attribute.starts_with("width=") && !attribute.starts_with("height="))
        .collect();
    format!("{}>{rest}", head.concat())
}

/// Text as HTML shows it.
struct Escaped<'a>(&'a str);

impl Display for Escaped<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|c| match c {
            '&' => out.write_str("&amp;"),
            '<' => out.write_str("&lt;"),
            '>' => out.write_str("&gt;"),
            c => out.write_char(c),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::page::plot::{Axis, Series, Style};

    #[test]
    fn a_page_is_whole_in_itself_and_escapes_what_it_is_told() {
        let axis = |label| Axis::from_zero(label, 3.0);
        let series = |name: &str, style| Series { name: name.to_owned(), points: vec![(0.5, 1.0), (2.0, 3.0)], style };
        let styles = [Style::Line, Style::Marked, Style::Dashed, Style::Published];
        let chart = Chart {
            title: "a < b".to_owned(),
            x: axis("x"),
            y: axis("y"),
            series: styles.map(|style| series("4 & 9", style)).to_vec(),
        };
        let page = Page {
            title: "T<1>".to_owned(),
            introduction: "<script>".to_owned(),
            figures: vec![Figure { chart, caption: "p & q".to_owned() }],
            text: "1 > 0".to_owned(),
        };
        let html = page.to_string();
        for expected in ["T&lt;1&gt;", "p &amp; q", "1 &gt; 0", "a &lt; b", "4 &amp; 9", "<polyline", "</svg>"] {
            assert!(html.contains(expected), "{expected}: {html}");
        }
        for never in ["<script", "href=", "src=", "@import", "url("] {
            assert!(!html.contains(never), "{never}");
        }
    }
}
