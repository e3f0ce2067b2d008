#!/usr/bin/env python3
"""Draws the beginning of bus-trace.json.gz, a trace of a simulated bus, as docs/images/bus-trace.svg: `docs/figures/bus_trace.py`.

The trace is that of `marti replay OUT --export chrome`, OUT the run of topologies/paper-teapot-9.toml with
`--set image.width=50 --set image.height=50 --record references`.
"""
import gzip
import json
import pathlib

HERE = pathlib.Path(__file__).parent
CYCLES = 12_000
WIDTH, LEFT, RIGHT, ROW, TOP = 960, 90, 30, 22, 24
TILE, STALL, BUS = "#d8e4f0", "#c0392b", "#1f4e79"

events = json.load(gzip.open(HERE / "bus-trace.json.gz"))["traceEvents"]
names = {event["pid"]: event["args"]["name"] for event in events if event["name"] == "process_name"}
rows = {pid: i for i, pid in enumerate(sorted(names))}
x = lambda cycle: LEFT + min(cycle, CYCLES) / CYCLES * (WIDTH - LEFT - RIGHT)
height = TOP + ROW * len(rows) + 40
out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif" font-size="12">',
       f'<rect width="{WIDTH}" height="{height}" fill="white"/>']


def bar(event, begin, end, colour, inset, title):
    if begin < CYCLES:
        y = TOP + ROW * rows[event["pid"]] + inset
        out.append(f'<rect x="{x(begin):.1f}" y="{y}" width="{max(x(end) - x(begin), 0.4):.1f}" height="{ROW - 2 - 2 * inset}" '
                   f'fill="{colour}"><title>{title}</title></rect>')


begun = {}
for event in sorted((e for e in events if "ts" in e), key=lambda e: e["ts"]):
    if event["ph"] == "B":
        begun[event["pid"]] = event
    elif event["ph"] == "E":
        begin = begun.pop(event["pid"])
        bar(begin, begin["ts"], event["ts"], TILE, 0, begin["name"])
for pid, begin in begun.items():
    bar(begin, begin["ts"], CYCLES, TILE, 0, begin["name"])
for event in events:
    if event["ph"] == "X":
        colour = BUS if event["cat"] == "bus" else STALL
        bar(event, event["ts"], event["ts"] + event["dur"], colour, 4, event["name"])
for pid, row in rows.items():
    name = names[pid].replace("cluster 0 ", "")
    out.append(f'<text x="{LEFT - 8}" y="{TOP + ROW * row + 15}" text-anchor="end">{name}</text>')
for cycle in range(0, CYCLES + 1, 2000):
    out.append(f'<text x="{x(cycle):.1f}" y="{TOP + ROW * len(rows) + 16}" text-anchor="middle">{cycle:,}</text>')
for i, (colour, what) in enumerate([(TILE, "a tile"), (STALL, "a node waits for the bus"), (BUS, "the bus is held")]):
    out.append(f'<rect x="{LEFT + 200 * i}" y="5" width="12" height="12" fill="{colour}"/>'
               f'<text x="{LEFT + 200 * i + 18}" y="15">{what}</text>')
out.append(f'<text x="{WIDTH / 2}" y="{height - 6}" text-anchor="middle">cycles</text></svg>')
(HERE.parent / "images" / "bus-trace.svg").write_text("\n".join(out) + "\n")
