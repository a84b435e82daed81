#!/usr/bin/env python3
"""pages.py COMMAND EXAMPLES OUT [--browser]: pages of `bromwich solve --report` and `bromwich plot` on several scenes.

Without --browser: every page is well-formed, stands alone, has the numbers that --json prints, and a picture for each
kind of column. With --browser: in a headless Chromium, in light, in dark and in print, no label overlaps another one or
leaves its picture, and text has enough contrast. Exit code 77: no browser here.
"""

import html.parser
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

VOID = {"meta", "br", "link", "img", "hr", "input"}

# Name, arguments, expected exit code, quantities with pictures.
SCENES = [
    ("template", ["{examples}/template.toml", "--states", "all"], 0, "ywx"),
    ("diode-bridge", ["{examples}/diode-bridge.toml", "--states", "all", "--steps", "400"], 0, "ywx"),
    ("signorini", ["signorini", "--set", "Q=39", "--method", "contour", "--steps", "100"], 0, "yw"),
    ("relay", ["{examples}/relay-sliding.toml", "--states", "all"], 0, "ywx"),
    ("infeasible", ["{examples}/fold.toml", "--states", "all"], 3, "ywx"),
    ("not-met", ["{examples}/rlcd.toml", "--method", "march", "--tol", "1e-9", "--max-steps", "2000", "--states", "all"], 3, "ywx"),
    ("tolerance", ["{examples}/rlcd.toml", "--method", "march", "--tol", "1e-3", "--states", "all"], 0, "ywx"),
    ("periodic", ["{examples}/periodic-rectifier.toml", "--states", "all"], 0, "ywx"),
    ("goal", ["ph-toy", "--method", "goal", "--steps", "80", "--states", "all"], 0, "x"),
]


class Balanced(html.parser.HTMLParser):
    """Every tag is closed in its order; nothing is fetched and nothing runs."""

    def __init__(self):
        super().__init__()
        self.open, self.faults, self.texts = [], [], []

    def handle_starttag(self, tag, attributes):
        if tag == "script" or any(name.startswith("on") for name, _ in attributes):
            self.faults.append(f"<{tag}> runs a script")
        for name, value in attributes:
            if name in ("src", "href") or (name == "style" and "url(" in (value or "")):
                self.faults.append(f"<{tag} {name}={value}> is fetched")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}> closes nothing")

    def handle_data(self, data):
        self.texts.append(data)


def faults_of(page):
    """Why a page is not well-formed or does not stand alone."""
    parser = Balanced()
    parser.feed(page)
    parser.close()
    yield from parser.faults
    if parser.open:
        yield f"not closed: {parser.open}"
    for reference in re.findall(r"@import|url\(|https?://[^\s\"<]+", page):
        if reference != "http://www.w3.org/2000/svg":
            yield f"refers to {reference}"


def check_faults():
    """The checks find faults."""
    for bad in ("<p><b></p></b>", "<div>", "<script>1</script>", '<img src="a.png"/>', "<p onclick='f()'></p>",
                "<style>@import 'a.css';</style>"):
        assert list(faults_of(bad)), bad
    assert not list(faults_of("<p>a<br/>b</p>"))


def run(command, *arguments, code=0, cwd):
    done = subprocess.run([command, *arguments], capture_output=True, text=True, cwd=cwd, timeout=1800)
    assert done.returncode == code, f"{arguments}: exit code {done.returncode}\n{done.stderr}"
    return done.stdout


def check_page(name, page, summary, quantities):
    faults = list(faults_of(page))
    assert not faults, f"{name}: {faults}"
    root = ElementTree.fromstring(page.replace("<!DOCTYPE html>", ""))
    shown = next(e for e in root.iter("pre") if e.get("id") == "summary")
    assert json.loads(shown.text) == summary, f"{name}: the page has other numbers than --json"
    headings = [e.text for e in root.iter("h2")]
    for letter, words in (("y", "y: "), ("w", "w = "), ("x", "x: ")):
        found = any(h.startswith(words) for h in headings)
        assert found == (letter in quantities), f"{name}: pictures of {letter}: {headings}"
    svg = "{http://www.w3.org/2000/svg}"
    for picture in root.iter(svg + "svg"):
        if picture.get("role") != "img":
            continue
        assert picture.find(svg + "title").text, f"{name}: a picture without a title"
        if picture.find(f"{svg}rect[@class='frame']") is None:
            continue
        labels = [t for t in picture.iter(svg + "text") if t.get("class") == "label"]
        assert labels and all(t.text for t in labels), f"{name}: an axis without a label"
    status = next(e for e in root.iter("div") if e.get("class", "").startswith("status"))
    assert summary["status"] in "".join(status.itertext()), f"{name}: the status is missing"
    return headings


def make_pages(command, examples, folder):
    pages = {}
    for name, arguments, code, quantities in SCENES:
        words = [word.format(examples=examples) for word in arguments]
        target = folder / f"{name}.html"
        out = run(command, "solve", *words, "--threads", "1", "--report", target, "--out", f"{name}.csv", "--json",
                  code=code, cwd=folder)
        (folder / f"{name}.json").write_text(out)
        pages[name] = target, json.loads(out), quantities
    return pages


def check_pages(command, pages, folder):
    for name, (path, summary, quantities) in pages.items():
        headings = check_page(name, path.read_text(encoding="utf-8"), summary, quantities)
        if name in ("signorini", "tolerance", "not-met", "goal"):
            assert "Convergence" in headings, f"{name}: no convergence in {headings}"
        if name in ("tolerance", "not-met"):
            assert "Error and tolerance" in headings, f"{name}: no tolerance in {headings}"
        # From the files it is the same page, without w.
        run(command, "plot", f"{name}.csv", "--summary", f"{name}.json", "--out", f"{name}-again.html", cwd=folder)
        again = (folder / f"{name}-again.html").read_text(encoding="utf-8")
        check_page(name + " again", again, summary, quantities.replace("w", ""))
        run(command, "plot", f"{name}.csv", "--out", f"{name}-alone.html", cwd=folder)
        assert not list(faults_of((folder / f"{name}-alone.html").read_text(encoding="utf-8")))


# What a browser says: pairs of labels that overlap, labels outside of their picture, and text whose contrast with the
# page is below 4.5 (WCAG 2, level AA).
PROBE = """
<script>
const faults = [];
const light = c => { const [r, g, b] = c.match(/[\\d.]+/g).map(v => v / 255)
  .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const page = light(getComputedStyle(document.body).backgroundColor);
const contrast = c => { const v = light(c); return (Math.max(v, page) + 0.05) / (Math.min(v, page) + 0.05); };
for (const e of document.querySelectorAll("p, td, th, h1, h2, figcaption, strong, svg text")) {
  const style = getComputedStyle(e), colour = e.namespaceURI.endsWith("svg") ? style.fill : style.color;
  if (contrast(colour) < 4.5) faults.push("contrast " + contrast(colour).toFixed(2) + ": " + e.textContent.slice(0, 40));
}
for (const line of document.querySelectorAll("svg .line, svg .level, svg .mark, svg .bar")) {
  const style = getComputedStyle(line), colour = line.matches(".bar, .mark") ? style.fill : style.stroke;
  if (contrast(colour) < 3) faults.push("contrast of a curve " + contrast(colour).toFixed(2));
}
for (const svg of document.querySelectorAll("svg")) {
  const frame = svg.getBoundingClientRect();
  const boxes = [...svg.querySelectorAll("text")].map(t => [t.textContent, t.getBoundingClientRect()]);
  boxes.forEach(([a, p], i) => {
    if (p.left < frame.left - 1 || p.right > frame.right + 1 || p.top < frame.top - 1 || p.bottom > frame.bottom + 1)
      faults.push("outside: " + a);
    boxes.slice(i + 1).forEach(([b, q]) => {
      const across = Math.min(p.right, q.right) - Math.max(p.left, q.left);
      const down = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
      if (across > 1 && down > 3) faults.push("overlap: " + a + " | " + b);
    });
  });
}
if (document.documentElement.scrollWidth > innerWidth + 1) faults.push("wider than the window");
const found = document.createElement("output");
found.id = "probe";
found.textContent = JSON.stringify({faults, dark: page < 0.5, texts: document.querySelectorAll("svg text").length});
document.body.append(found);
</script>
"""
MODES = {
    "light": (["--blink-settings=preferredColorScheme=1"], 900),
    "dark": (["--blink-settings=preferredColorScheme=0"], 900),
    "narrow": (["--blink-settings=preferredColorScheme=1"], 560),
}


def find_browser():
    names = os.environ.get("BROMWICH_BROWSER", "chromium chromium-browser google-chrome chrome").split()
    return next((path for path in map(shutil.which, names) if path), None)


def browse(browser, profile, options, width, path):
    return subprocess.run(
        [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-extensions",
         f"--user-data-dir={profile}", f"--window-size={width},1200", *options, path.as_uri()],
        capture_output=True, text=True, timeout=1800)


def probe(browser, profile, mode, page, folder):
    copy = folder / "probed.html"
    copy.write_text(page.replace("</body>", PROBE + "</body>"), encoding="utf-8")
    options, width = MODES[mode]
    dom = browse(browser, profile, [*options, "--dump-dom"], width, copy).stdout
    found = re.search(r'<output id="probe">(.*?)</output>', dom, re.S)
    assert found, f"the browser has not shown the page: {dom[:300]}"
    return json.loads(html.unescape(found.group(1)))


def check_in_browser(browser, pages, folder):
    with tempfile.TemporaryDirectory() as profile:
        bad = ('<html><body style="background:#fff"><svg viewBox="0 0 9 9" width="200"><text x="1" y="5">ab</text>'
               '<text x="1" y="5">cd</text></svg><p style="color:#ccc">pale</p></body></html>')
        faults = " ".join(probe(browser, profile, "light", bad, folder)["faults"])
        assert "overlap" in faults and "contrast" in faults, f"the probe accepts anything: {faults}"
        for name, (path, _, _) in pages.items():
            for mode in MODES:
                found = probe(browser, profile, mode, path.read_text(encoding="utf-8"), folder)
                assert found["dark"] == (mode == "dark"), f"{name}: {mode} has the wrong paper"
                assert not found["faults"], f"{name}, {mode}: {found['faults']}"
        path = pages["template"][0]
        paper = folder / "template.pdf"
        browse(browser, profile, ["--blink-settings=preferredColorScheme=0", "--no-pdf-header-footer",
                                  f"--print-to-pdf={paper}"], 900, path)
        assert paper.read_bytes().startswith(b"%PDF"), "the page is not printed"


def main(command, examples, out, *options):
    browser = find_browser()
    if options and browser is None:
        print("pages: skipped, no Chromium (Debian 12: chromium)")
        return 77
    folder = Path(out).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    check_faults()
    pages = make_pages(Path(command).resolve(), Path(examples).resolve(), folder)
    if options:
        check_in_browser(browser, pages, folder)
    else:
        check_pages(Path(command).resolve(), pages, folder)
    print(f"pages: {len(pages)} pages in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
