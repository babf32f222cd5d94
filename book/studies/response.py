"""Measure how soon the tuner answers a move, on the built site in Chromium.

    python -m book.studies.response --moves 40

Moves gamma as a hand does, from one end to the other, and waits for each answer: the picture of the coarse mesh, and
the fit on the page's mesh. Prints the time to the first picture of the page, and medians and 95 % of both.
"""

import functools
import shutil
import threading
import time
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import click
import numpy as np
from playwright.sync_api import sync_playwright

from qclearn.io.provenance import provenance

SITE = Path(__file__).resolve().parents[2] / "_build" / "html"
ROOT = ".qc-live[data-page=tuner]"
# Moves gamma, and gives the milliseconds to the next answer, and to the one on the page's mesh.
MOVE = """([root, value]) => new Promise(done => {
  const frame = document.querySelector(root), slider = frame.querySelector('input[type=range]');
  const numbers = frame.querySelector('.qc-live-numbers'), start = performance.now();
  let first = null;
  frame.addEventListener('qc-live-answer', () => (first ??= performance.now() - start), {once: true});
  new MutationObserver((_, observer) => {
    if (first === null || !numbers.textContent.includes('mesh is 24 x 72')) return;
    observer.disconnect();
    done([first, performance.now() - start]);
  }).observe(numbers, {childList: true, characterData: true, subtree: true});
  slider.value = value;
  slider.dispatchEvent(new Event('input'));
})"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


@click.command()
@click.option("--moves", default=40, help="Steps of gamma from one end to the other.")
def main(moves):
    handler = functools.partial(Quiet, directory=SITE)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, sync_playwright() as playwright:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        start = time.perf_counter()
        page.goto(f"http://127.0.0.1:{server.server_port}/live.html", wait_until="commit")
        page.wait_for_selector(f"{ROOT}[data-ready]", timeout=60_000)
        opened = time.perf_counter() - start
        page.wait_for_function(f"() => document.querySelector('{ROOT} [role=status]').ariaBusy === 'false'")
        took = [page.evaluate(MOVE, [ROOT, float(gamma)]) for gamma in np.linspace(0.1, 7, moves)]
        browser.close()
        server.shutdown()
    for words, ms in zip(("picture", "fit"), np.array(took).T):
        print(f"{words:8} median {np.median(ms):.0f} ms, 95 % {np.percentile(ms, 95):.0f} ms")
    print(f"first picture {opened:.1f} s after the page's address; {moves} moves; {provenance()}")


if __name__ == "__main__":
    main()
