"""Explorables in a real JupyterLab: what Python sets is drawn, what is moved is seen by Python, the kernel is asked."""

import nbformat
import pytest
from laboratory import OPEN, wait_until_idle
from nbformat.v4 import new_code_cell, new_notebook

ROOT = ".jp-OutputArea .qc-live[data-ready]"


class Notebook:
    """A notebook of the test's own in JupyterLab, opened and run; `run` executes more code: what it printed."""

    def __init__(self, browser, lab, name, *cells):
        notebook = new_notebook(
            metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}},
            cells=[new_code_cell(source) for source in cells],
        )
        nbformat.write(notebook, lab.root / "planted" / f"{name}.ipynb")
        self.page, self.requests, self.complaints = browser.new_page(viewport={"width": 1300, "height": 1600}), [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.complaints.append(error.message))
        self.page.goto(f"{lab.address}lab?reset")
        self.page.wait_for_function("() => window.jupyterapp", timeout=60_000)
        self.page.evaluate("() => window.jupyterapp.restored")
        self.page.evaluate(OPEN, [f"planted/{name}.ipynb", True])
        wait_until_idle(self.page)
        self.page.evaluate("() => window.jupyterapp.commands.execute('notebook:run-all-cells')")
        self.page.wait_for_selector(ROOT, timeout=120_000)
        wait_until_idle(self.page)

    def run(self, code):
        """What the kernel prints for a line of code."""
        return self.page.evaluate(
            """async code => {
              const kernel = window.panel.sessionContext.session.kernel, future = kernel.requestExecute({code});
              let text = '';
              future.onIOPub = ({header, content}) => {
                if (header.msg_type === 'stream') text += content.text;
                if (header.msg_type === 'error') text += `${content.ename}: ${content.evalue}`;
              };
              await future.done;
              return text.trim();
            }""",
            code,
        )

    @property
    def words(self):
        return self.page.locator(f"{ROOT} [role=status]").inner_text()

    def picture(self):
        return self.page.locator(f"{ROOT} canvas").last.evaluate("canvas => canvas.toDataURL()")

    def wait_for(self, place, what):
        self.page.wait_for_function(
            "([place, text]) => document.querySelector(place)?.textContent.includes(text)",
            arg=[place, what],
            timeout=60_000,
        )

    def from_elsewhere(self, lab):
        return [url for url in self.requests if not url.startswith((lab.address, "data:", "blob:"))]


@pytest.fixture(scope="module")
def mobius(browser, lab):
    imports = "from qclearn.pages.explorables import Mobius\nfrom qclearn.pages.live import explorable\n"
    made = imports + "explorer = explorable(Mobius())\nexplorer"
    notebook = Notebook(browser, lab, "mobius", made)
    yield notebook
    notebook.page.close()


def test_what_python_sets_is_drawn(mobius):
    before = mobius.picture()
    assert (
        mobius.run("explorer.size = 0.7; explorer.direction = 90.0; print(explorer.a)")
        == "(4.286263797015736e-17+0.7j)"
    )
    mobius.wait_for(f"{ROOT} [role=status]", "+ 0.7 i")
    assert mobius.picture() != before


def test_what_is_moved_is_seen_by_python(mobius):
    slider = mobius.page.get_by_role("slider", name="turn of the disk")
    slider.focus()
    mobius.page.keyboard.press("End")
    mobius.wait_for(f"{ROOT} [role=status]", "θ = 180°")
    for _ in range(40):  # the state is on its way to the kernel
        seen = mobius.run("print(explorer.turn)")
        if seen == "180":
            break
        mobius.page.wait_for_timeout(250)
    assert seen == "180"


def test_the_kernel_finds_the_same(mobius):
    mobius.page.get_by_role("button", name="Ask the kernel").click()
    mobius.wait_for(f"{ROOT} [role=status]", "The kernel's red circle")
    assert float(mobius.words.split("difference is ")[1].rstrip(".")) < 1e-12
    found = mobius.run("print(explorer.found['radius'] - explorer.live.answer(explorer.state)['radius'])")
    assert abs(float(found)) < 1e-12


def test_nothing_complains_and_nothing_comes_from_elsewhere(mobius, lab):
    assert mobius.complaints == [] and mobius.from_elsewhere(lab) == []


@pytest.fixture(scope="module")
def tuner(browser, lab):
    imports = "from qclearn.pages.explorables import Tuner\nfrom qclearn.pages.live import explorable\n"
    notebook = Notebook(browser, lab, "tuner", imports + "tuner = explorable(Tuner())\ntuner")
    notebook.wait_for(f"{ROOT} [role=status]", "CP-Net: landmark error")
    yield notebook
    notebook.page.close()


def test_weights_that_python_sets_are_fitted(tuner):
    before = tuner.words
    tuner.run("tuner.problem = 'twist'; tuner.alpha = 10.0; tuner.gamma = 1e4")
    tuner.page.wait_for_function(
        "([place, before]) => document.querySelector(place).textContent !== before && "
        "document.querySelector('.qc-live select').value === 'twist'",
        arg=[f"{ROOT} [role=status]", before],
        timeout=60_000,
    )
    assert tuner.page.get_by_role("slider", name="alpha").input_value() == "1"
    assert tuner.run("print(tuner.map.shape, bool(abs(tuner.map).max() < 1 + 1e-9))") == "(1729,) True"


def test_the_librarys_fit_is_asked_for(tuner):
    tuner.page.get_by_role("button", name="Ask the kernel").click()
    tuner.wait_for(f"{ROOT} [role=status]", "The kernel's fit has L_CP")
    assert float(tuner.words.split("two maps is ")[1].rstrip(".")) < 1e-2  # each stops by a rule of its own


def test_the_tuner_complains_of_nothing_and_asks_nothing_from_elsewhere(tuner, lab):
    assert tuner.complaints == [] and tuner.from_elsewhere(lab) == []
