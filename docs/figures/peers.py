#!/usr/bin/env python3
"""Draws peers.csv, million rays a second by scene and renderer, as docs/images/peers.svg: `docs/figures/peers.py`."""
import csv
import pathlib

HERE = pathlib.Path(__file__).parent
SHOWN = [
    ("marti packets", "marti, packets", "#c0392b"),
    ("marti single", "marti, single rays", "#e6a39b"),
    ("embree 8", "Embree, packets of 8", "#1f4e79"),
    ("embree 8 robust", "Embree robust, packets of 8", "#4a7fb0"),
    ("embree single", "Embree, single rays", "#9dbfdd"),
    ("tachyon", "Tachyon", "#7f8c8d"),
    ("povray", "POV-Ray", "#bdc3c7"),
]
SCENES = {"gears2": "gears 2", "gears4": "gears 4", "teapot12": "teapot 12", "tetra10": "tetra 10", "teapot90": "teapot 90"}
WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 900, 380, 50, 50, 30

rates = {}
with open(HERE / "peers.csv", newline="") as file:
    for row in csv.DictReader(file):
        rates[row["scene"], row["renderer"]] = float(row["million_rays_a_second"])

top = max(rates[scene, key] for scene in SCENES for key, _, _ in SHOWN if (scene, key) in rates) * 1.05
plot_height = HEIGHT - TOP - BOTTOM
group = (WIDTH - LEFT) / len(SCENES)
bar = group * 0.8 / len(SHOWN)
out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="12">',
       f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>']
for tick in range(0, int(top) + 1, 5):
    y = TOP + plot_height * (1 - tick / top)
    out.append(f'<line x1="{LEFT}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/>')
    out.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{tick}</text>')
out.append(f'<text x="{LEFT}" y="14" font-size="13">million rays a second of one thread, shading included, 1000×1000</text>')
x = LEFT
for key, label, colour in SHOWN:
    out.append(f'<rect x="{x}" y="24" width="10" height="10" fill="{colour}"/><text x="{x + 14}" y="33" font-size="11">{label}</text>')
    x += 24 + 6.2 * len(label)
for i, (scene, label) in enumerate(SCENES.items()):
    start = LEFT + group * i + group * 0.1
    for j, (key, _, colour) in enumerate(SHOWN):
        rate = rates.get((scene, key))
        if rate is None:
            continue
        height = plot_height * rate / top
        out.append(f'<rect x="{start + bar * j:.1f}" y="{TOP + plot_height - height:.1f}" width="{bar * 0.9:.1f}" height="{height:.1f}" fill="{colour}"><title>{label}, {key}: {rate}</title></rect>')
    out.append(f'<text x="{start + group * 0.4:.1f}" y="{HEIGHT - 10}" text-anchor="middle">{label}</text>')
out.append("</svg>")
(HERE.parent / "images" / "peers.svg").write_text("\n".join(out) + "\n")
