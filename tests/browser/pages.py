#!/usr/bin/env python3
"""Opens the pages of both studies in Chromium, narrow and wide, light and dark, and uses them by mouse and by keyboard.

    tests/browser/pages.py MARTI [SCREENSHOTS]

Needs Debian's chromium and playwright of PyPI. Without SCREENSHOTS the pictures are in a temporary folder, and deleted.
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

from playwright.sync_api import sync_playwright

ROOT = pathlib.Path(__file__).parent.parent.parent
CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
STUDIES = {
    "sweep": ["study", "sweep", str(ROOT / "tests/data/teapot-64.toml"), "--set", "run.assignment=interleaved",
              "--local-memory", "1/32..1/4", "--nodes", "4,9", "--replacement", "lru,fifo", "--timings"],
    "paper": ["study", "paper"],
}
WIDTHS = [400, 1400]
SCHEMES = ["light", "dark"]


def main():
    marti = str(pathlib.Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        shots = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else scratch)
        shots.mkdir(parents=True, exist_ok=True)
        for name, arguments in STUDIES.items():
            folder = pathlib.Path(scratch) / name
            subprocess.run([marti, *arguments, "--out", str(folder), "--quiet"], check=True, stdout=subprocess.DEVNULL)
            assert (folder / "study.csv").stat().st_size > 0, "study.csv is beside the page"
            study = json.loads((folder / "study.json").read_text())
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
            for width in WIDTHS:
                for scheme in SCHEMES:
                    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
                    look(page, folder, scheme, shots / f"{name}-{width}-{scheme}.png")
                    if name == "sweep":
                        mouse(page, study)
                    keyboard(page)
                    switches(page)
                    sorts(page)
                    page.close()
                    print(f"{name}, {width} pixels, {scheme}: in order")
            without_script(browser, folder)
            browser.close()


def look(page, folder, scheme, shot):
    """It loads nothing but itself, reports no error, fits, and has the scheme's colours."""
    requests, errors = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    url = (folder / "study.html").as_uri()
    page.goto(url)
    assert requests == [url] and not errors, (requests, errors)
    wide = page.evaluate("""() => {
        const room = document.documentElement.clientWidth;
        const scrolls = element => element.closest(".box") && !element.matches(".box");
        return [...document.body.querySelectorAll("*")].filter(element => !scrolls(element)
            && element.getBoundingClientRect().right > room + 0.5).map(element => element.outerHTML.slice(0, 80));
    }""")
    assert not wide, f"beyond the right edge: {wide}"
    red = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0]")
    assert (int(red) < 128) == (scheme == "dark"), f"{scheme}: {red}"
    sizes = page.evaluate("""[...document.querySelectorAll("figure svg text")].map(
        text => parseFloat(getComputedStyle(text).fontSize) * Math.hypot(text.getScreenCTM().a, text.getScreenCTM().b))""")
    assert min(sizes) > 9, f"text of charts is {min(sizes):.1f} pixels high"
    about = page.locator(".about").inner_text()
    assert all(word in about for word in ["command", "marti study", "version", "date", "UTC", "host", "processor"]), about
    page.screenshot(path=str(shot), full_page=True)


def value(page):
    return page.locator("#value").inner_text()


def mouse(page, study):
    """Every point of the first chart shows what study.json has."""
    first = study["rows"][0]
    chart = page.locator("figure svg").first
    wanted = sorted(100 * row["misses_per_record_access"] for row in study["rows"])
    points = chart.locator(".point")
    found = sorted(float(points.nth(i).get_attribute("data-y")) for i in range(points.count()))
    assert len(found) == len(wanted) and all(abs(a - b) <= 1e-9 * b for a, b in zip(found, wanted)), (found, wanted)
    last = points.last
    last.scroll_into_view_if_needed()
    last.hover(force=True)
    shown, y = value(page), float(last.get_attribute("data-y"))
    number = float(re.search(r", ([\d.]+) % of record accesses$", shown)[1])
    assert abs(number - y) <= 1e-5 * y, (shown, y)
    page.mouse.move(0, 0)
    assert value(page) == "", "nothing is shown where there is no point"
    cycles = page.locator("figure svg").nth(1).locator(".point").evaluate_all("all => all.map(point => +point.dataset.y)")
    assert any(abs(y - first["cycles"] * 1e-6) < 1e-9 * y for y in cycles), "cycles are charted"


def keyboard(page):
    """One stop per chart for Tab; arrows follow a series, and change it."""
    chart = page.locator("figure svg").first
    assert chart.locator('.point[tabindex="0"]').count() == 1
    chart.locator('.point[tabindex="0"]').focus()
    texts = [value(page)]
    series = page.evaluate("document.activeElement.closest('.series').dataset.series")
    count = chart.locator(f'.series[data-series="{series}"] .point').count()
    for _ in range(count - 1):
        page.keyboard.press("ArrowRight")
        texts.append(value(page))
    assert len(set(texts)) == count > 1, f"each point has its value: {texts}"
    page.keyboard.press("ArrowRight")
    assert value(page) == texts[-1], "the last point is the end"
    page.keyboard.press("ArrowDown")
    assert page.evaluate("document.activeElement.closest('.series').dataset.series") != series
    assert page.locator("#value").get_attribute("aria-live") == "polite" and value(page)


def switches(page):
    """A legend's entry hides its series and brings it back."""
    chart = page.locator("figure svg").first
    key, series = chart.locator(".key").first, chart.locator(".series").first
    for state in ["false", "true"]:
        key.focus()
        page.keyboard.press("Space")
        assert key.get_attribute("aria-checked") == state
        assert series.is_visible() == (state == "true")


def sorts(page):
    """By keyboard alone: up, then down."""
    table = page.locator("table.sortable").first
    numeric = table.locator("tbody tr").first.locator("td[data-value]").count() > 0
    column = table.locator("th").count() - 2 if numeric else 0
    head = table.locator("th").nth(column)
    cells = lambda: table.locator(f"tbody tr td:nth-child({column + 1})").evaluate_all(
        "all => all.map(cell => cell.dataset.value === undefined ? cell.textContent : +cell.dataset.value)")
    before = cells()
    head.locator("button").focus()
    page.keyboard.press("Enter")
    up = cells()
    assert head.get_attribute("aria-sort") == "ascending"
    page.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert sorted(up, key=str) == sorted(before, key=str), "no row is lost"
    assert cells()[0] == up[-1] and up[0] != up[-1], (before, up)
    if numeric:
        assert up == sorted(up), up


def without_script(browser, folder):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((folder / "study.html").as_uri())
    assert page.locator("figure svg polyline").first.is_visible() and page.locator("table").first.is_visible()
    assert page.locator(".point title").count() > 0, "browsers show titles by themselves"
    context.close()


main()
