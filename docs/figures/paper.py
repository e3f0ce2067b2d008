#!/usr/bin/env python3
"""Takes the charts of `marti study paper --out DIR` into docs/images/paper-*.svg: `docs/figures/paper.py DIR/study.html`."""
import pathlib
import re
import sys

NAMES = ["figure1", "figure6", "figure7", "table1-gears", "table1-teapot", "lru",
         "contention-gears", "contention-teapot"]
IMAGES = pathlib.Path(__file__).parent.parent / "images"

charts = re.findall(r"<svg.*?</svg>", pathlib.Path(sys.argv[1]).read_text(), re.DOTALL)
assert len(charts) == len(NAMES), f"{len(charts)} charts, expected {len(NAMES)}"
for name, chart in zip(NAMES, charts):
    (IMAGES / f"paper-{name}.svg").write_text(chart + "\n")
