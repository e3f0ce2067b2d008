#!/usr/bin/env python3
"""Draws the longest waits for a tile of two campaigns, by what was done to whom, as docs/images/recovery.svg, from chaos.csv
(`cargo bench --bench chaos`) and chaos-namespaces.csv (with `--namespaces`), both without their last column:
`docs/figures/recovery.py`."""
import csv
import math
import pathlib
import random
import statistics

HERE = pathlib.Path(__file__).parent
COLOURS = {"kill": "#c0392b", "stop": "#d68910", "cut": "#7d3c98", "corrupt": "#16a085", "link": "#1f4e79"}
WIDTH, ROW, LEFT, TOP, LEAST, MOST = 900, 24, 170, 44, 0.001, 10.0

waits = {}
for name in ("chaos.csv", "chaos-namespaces.csv"):
    with open(HERE / name, newline="") as file:
        for row in csv.DictReader(file):
            assert row["verdict"] == "good", row
            if int(row["link_cuts"]) == 1 and not row["chaos"]:
                waits.setdefault("link down", []).append(float(row["longest_wait_in_journal_seconds"]))
            elif row["link_cuts"] == "0" and row["faults"] == "1" and ";" not in row["chaos"]:
                words = row["chaos"].replace("@", " ").split()
                waits.setdefault(f"{words[0]} {words[1]}", []).append(float(row["longest_wait_seconds"]))

names = sorted(waits, key=lambda name: (list(COLOURS).index(name.split()[0]), name))
height = TOP + ROW * len(names) + 30


def x(wait):
    share = math.log(max(wait, LEAST) / LEAST) / math.log(MOST / LEAST)
    return LEFT + (WIDTH - LEFT - 20) * share


random.seed(1)
out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="12">',
       f'<rect width="{WIDTH}" height="{height}" fill="white"/>',
       f'<text x="10" y="18" font-size="13">longest wait for another tile, a dot a run with this fault alone; the line is the median</text>']
for tick in (0.001, 0.01, 0.1, 1, 10):
    label = f"{tick:g} s" if tick > 0.001 else "1 ms or less"
    out.append(f'<line x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="{TOP - 10}" y2="{height - 24}" stroke="#ddd"/>')
    out.append(f'<text x="{x(tick):.1f}" y="{height - 8}" text-anchor="middle">{label}</text>')
for i, name in enumerate(names):
    y, colour = TOP + ROW * i + ROW / 2, COLOURS[name.split()[0]]
    out.append(f'<text x="{LEFT - 12}" y="{y + 4:.1f}" text-anchor="end">{name} ({len(waits[name])})</text>')
    for wait in waits[name]:
        jitter = random.uniform(-0.32, 0.32) * ROW
        out.append(f'<circle cx="{x(wait):.1f}" cy="{y + jitter:.1f}" r="2.2" fill="{colour}" fill-opacity="0.55"/>')
    median = x(statistics.median(waits[name]))
    out.append(f'<line x1="{median:.1f}" x2="{median:.1f}" y1="{y - ROW * 0.42:.1f}" y2="{y + ROW * 0.42:.1f}" stroke="black" stroke-width="1.5"/>')
out.append("</svg>")
(HERE.parent / "images" / "recovery.svg").write_text("\n".join(out) + "\n")
for name in names:
    print(f"{name:22} {len(waits[name]):4} {statistics.median(waits[name]):7.3f} {max(waits[name]):7.3f}")
