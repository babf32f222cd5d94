"""Print how soon the explorables of the built site answer and how many bytes they bring, beside what is asked for.

    python tools/live_latency.py

Wall times of one browser, so of a quiet machine: other jobs double them. Sizes are those of a server that does not
compress.
"""

import functools
import re
import shutil
import statistics
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from playwright.sync_api import sync_playwright

SITE = Path(__file__).resolve().parent.parent / "_build" / "html"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
MOVES = 20
MB = 1e6
SOLID = ("sulci", "growth")  # explorables with a scene in 3-D
ASKED = {"first": 1500, "median": 100, "worst": 250, "site": 6.0, "explorable": 1.8, "3-D": 3.0, "page": 8.0}
# When the first answer of an explorable stood there, in milliseconds since the page was asked for.
LISTEN = """window.first = {};
document.addEventListener('qc-live-answer', event => {
  window.first[event.target.dataset.page] ??= performance.now();
}, true);"""
# Milliseconds from an input of a slider to the next frame after the newest answer, for a number of moves.
MOVE = """async ([name, label, moves]) => {
  const root = document.querySelector(`.qc-live[data-page=${name}]`);
  const row = [...root.querySelectorAll('label')].find(e => e.textContent.includes(label));
  const slider = document.getElementById(row.htmlFor), took = [];
  const frame = () => new Promise(requestAnimationFrame);
  const newest = () => new Promise(done => root.addEventListener('qc-live-answer', function hear({detail}) {
    if (detail.number < detail.of) return;
    root.removeEventListener('qc-live-answer', hear);
    done();
  }));
  for (let k = 0; k < moves; k++) {
    await new Promise(done => setTimeout(done, 400));
    const answered = newest(), begin = performance.now();
    const [low, high] = [Number(slider.min), Number(slider.max)];
    slider.value = low + (high - low) * (0.3 + 0.5 * ((k * 7) % moves) / moves);
    slider.dispatchEvent(new Event('change'));
    await answered;
    await frame();
    took.push(performance.now() - begin);
  }
  return took;
}"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


def explorables():
    """Pairs (page of the site, name of an explorable on it)."""
    for path in sorted(SITE.glob("*.html")):
        for name in re.findall(r'class="qc-live" data-page="(\w+)"', path.read_text(encoding="utf-8")):
            yield path.name, name


def visit(browser, address, page, name):
    """A page in a tab once its explorable has answered, and what it downloads, then and later: URL -> bytes."""
    tab, sizes = browser.new_page(), {}
    tab.add_init_script(LISTEN)
    tab.on("requestfinished", lambda request: sizes.setdefault(request.url, request.sizes()["responseBodySize"]))
    tab.goto(address + page, timeout=120_000)
    tab.wait_for_function("name => window.first[name]", arg=name, timeout=120_000)
    tab.wait_for_load_state("networkidle")
    return tab, sizes


def line(what, value, unit, asked):
    """A line of the table."""
    verdict = "" if asked is None else f"asked {asked:g} {unit}: {'reached' if value <= asked else 'MISSED'}"
    print(f"{what:58s} {value:9.2f} {unit:3s} {verdict}")


def report(browser, address):
    """Visit each explorable and print its figures."""
    for page, name in explorables():
        tab, sizes = visit(browser, address, page, name)
        line(f"{name} ({page}): first answer", tab.evaluate("name => window.first[name]", name), "ms", ASKED["first"])
        label = tab.locator(f".qc-live[data-page={name}] .qc-live-slider label").first.text_content()
        slider = "gamma" if name in ("tuner", "sulci") else label
        took = tab.evaluate(MOVE, [name, slider, MOVES])
        line(f"{name}: {slider[:20]} to pictures, median of {MOVES}", statistics.median(took), "ms", ASKED["median"])
        line(f"{name}: the worst of them", max(took), "ms", ASKED["worst"])
        own = sum(size for url, size in sizes.items() if "_static/live/" in url)
        line(f"{name}: modules, weights, data", own / MB, "MB", ASKED["3-D" if name in SOLID else "explorable"])
        line(f"{name}: the page over the wire", sum(sizes.values()) / MB, "MB", ASKED["page"])
        tab.close()
    files = [path.stat().st_size for path in (SITE / "_static" / "live").iterdir()]
    line("modules, weights and data of the whole site", sum(files) / MB, "MB", ASKED["site"])


def main():
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not (SITE / "_static" / "live").exists() or path is None:
        sys.exit("live_latency: build the site with `make book`, and install Chromium")
    handler = functools.partial(Quiet, directory=SITE)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, sync_playwright() as playwright:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS)
        report(browser, f"http://127.0.0.1:{server.server_port}/")
        browser.close()
        server.shutdown()


if __name__ == "__main__":
    main()
