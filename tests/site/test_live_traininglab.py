"""The training lab in JupyterLab: started, watched, gone on with."""

import pytest

pytestmark = pytest.mark.xdist_group("JupyterLab")
LAB = "from qcbook.traininglab import training_lab\nlab = training_lab()\nlab.seconds.value = 2\nlab"


def test_it_trains_in_jupyterlab(notebook):
    notebook.add(LAB)
    notebook.page.get_by_role("button", name="Start anew").click()
    said = notebook.page.locator("[role=status]:has-text('L_CP of CP-Net in training is')")
    said.wait_for(timeout=120_000)
    assert notebook.page.locator(".jp-OutputArea img[alt^='The network']").count() == 1
    assert notebook.page.locator(".jp-OutputArea img[alt^='After']").count() == 1
    steps = int(notebook.run("print(len(lab.lesson.history))"))
    assert f"{steps} steps" in said.inner_text()
    notebook.page.get_by_role("button", name="Go on").click()
    notebook.until(f"len(lab.lesson.history) > {steps}", 60)
    notebook.run("lab.halt()")
    assert notebook.complaints == []
