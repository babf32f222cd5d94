"""Print how soon the explorables of the built site answer and how many bytes they bring, beside
what is asked for.

    python -m book.studies.live_latency                # all; or some: live_latency.py tuner mu

Times by the clock are true on a quiet machine alone. The time that the browser's own processes
compute, on all threads, is printed beside them where the system tells it (Linux); other jobs do not
add to it. Sizes are those of a server that does not compress.
"""

import contextlib
import functools
import math
import os
import re
import shutil
import statistics
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from playwright.sync_api import sync_playwright

SITE = Path(__file__).resolve().parents[2] / "_build" / "html"
FLAGS = ["--no-sandbox"]
GRAPHICS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # for scenes in 3-D, where there is no card
MOVES = 20
PAUSE = 200  # milliseconds between moves, for what comes later than an answer
MB = 1e6
SOLID = ("sulci", "growth")  # explorables with a scene in 3-D
ASKED = {"first": 1500, "median": 100, "worst": 250, "site": 6.0, "explorable": 1.8, "3-D": 3.0, "page": 8.0}
# When the first answer of an explorable stood there, in milliseconds since the page was asked for.
LISTEN = """window.first = {};
document.addEventListener('qc-live-answer', event => {
  window.first[event.target.dataset.page] ??= performance.now();
}, true);"""
# Milliseconds from an input of a slider, to a share of its range, to the next frame after the
# newest answer.
MOVE = """async ([name, label, share]) => {
  const root = document.querySelector(`.qc-live[data-page=${name}]`);
  const row = [...root.querySelectorAll('label')].find(e => e.textContent.includes(label));
  const slider = document.getElementById(row.htmlFor);
  const answered = new Promise(done => root.addEventListener('qc-live-answer', function hear({detail}) {
    if (detail.number < detail.of) return;
    root.removeEventListener('qc-live-answer', hear);
    done();
  }));
  const [low, high] = [Number(slider.min), Number(slider.max)], begin = performance.now();
  slider.value = low + (high - low) * share;
  slider.dispatchEvent(new Event('change'));
  await answered;
  await new Promise(requestAnimationFrame);
  return performance.now() - begin;
}"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


def explorables():
    """Pairs (page of the site, name of an explorable on it)."""
    for path in sorted(SITE.glob("*.html")):
        for name in re.findall(r'class="qc-live" data-page="(\w+)"', path.read_text(encoding="utf-8")):
            yield path.name, name


def computed():
    """Milliseconds that the browser has computed so far, on all its threads; NaN where the system
    does not tell."""
    if not Path("/proc/self/schedstat").exists():
        return math.nan
    parents, found, total = {}, {os.getpid()}, 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
    while new := {process for process, parent in parents.items() if parent in found} - found:
        found |= new
    for process in found - {os.getpid()}:
        for path in Path(f"/proc/{process}/task").glob("*/schedstat"):
            with contextlib.suppress(OSError):
                total += int(path.read_text().split()[0])
    return total / 1e6


def visit(browser, address, page, name):
    """A page in a tab once its explorable has answered, what it computed until then in
    milliseconds, and what it downloads, then and later: URL -> bytes."""
    tab, sizes, before = browser.new_page(), {}, computed()
    tab.add_init_script(LISTEN)
    tab.on("requestfinished", lambda request: sizes.setdefault(request.url, request.sizes()["responseBodySize"]))
    tab.goto(address + page, timeout=120_000, wait_until="commit")
    tab.wait_for_function("name => window.first?.[name]", arg=name, timeout=120_000)
    work = computed() - before
    tab.wait_for_load_state("load", timeout=120_000)
    tab.wait_for_load_state("networkidle", timeout=120_000)
    return tab, work, sizes


def moved(tab, name, slider):
    """Milliseconds of MOVES moves of a slider: by the clock, and what the browser computed."""
    clock, work = [], []
    for k in range(MOVES):
        tab.wait_for_timeout(PAUSE)
        before = computed()
        clock.append(tab.evaluate(MOVE, [name, slider, 0.3 + 0.5 * (7 * k % MOVES) / MOVES]))
        work.append(computed() - before)
    return clock, work


def line(what, value, unit, asked):
    """A line of the table."""
    verdict = "" if asked is None else f"asked {asked:g} {unit}: {'reached' if value <= asked else 'MISSED'}"
    print(f"{what:58s} {value:9.2f} {unit:3s} {verdict}", flush=True)


def report(start, address, page, name):
    """Visit an explorable in a browser of its own and print its figures."""
    browser = start(args=[*FLAGS, *(GRAPHICS if name in SOLID else [])])
    tab, work, sizes = visit(browser, address, page, name)
    line(f"{name} ({page}): first answer", tab.evaluate("name => window.first[name]", name), "ms", ASKED["first"])
    line(f"{name}: computed for it, and for the whole page", work, "ms", None)
    label = tab.locator(f".qc-live[data-page={name}] .qc-live-slider label").first.text_content()
    slider = "gamma" if name in ("tuner", "sulci") else label
    for kind, took in zip(("by the clock", "computed"), moved(tab, name, slider)):
        line(f"{name}: {slider[:16]} moved, {kind}, median of {MOVES}", statistics.median(took), "ms", ASKED["median"])
        line(f"{name}: the worst of them", max(took), "ms", ASKED["worst"])
    own = sum(size for url, size in sizes.items() if "_static/live/" in url)
    line(f"{name}: modules, weights, data", own / MB, "MB", ASKED["3-D" if name in SOLID else "explorable"])
    line(f"{name}: the page over the wire", sum(sizes.values()) / MB, "MB", ASKED["page"])
    browser.close()


def main():
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if not (SITE / "_static" / "live").exists() or path is None:
        sys.exit("live_latency: build the site with `make book`, and install Chromium")
    handler = functools.partial(Quiet, directory=SITE)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, sync_playwright() as playwright:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        start = functools.partial(playwright.chromium.launch, executable_path=path)
        for page, name in explorables():
            if name in (sys.argv[1:] or [name]):
                report(start, f"http://127.0.0.1:{server.server_port}/", page, name)
        server.shutdown()
    files = [path.stat().st_size for path in (SITE / "_static" / "live").iterdir()]
    line("modules, weights and data of the whole site", sum(files) / MB, "MB", ASKED["site"])


if __name__ == "__main__":
    main()
