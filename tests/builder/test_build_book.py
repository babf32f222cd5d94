"""The build sees an error that a widget's callback hid from nbmake, and executes what is out of date."""

import json

import pytest
from nbformat.v4 import new_code_cell, new_notebook, new_output

from book.builder import execute_pages
from book.builder.execute_pages import errors_in

ERROR = new_output("error", ename="ValueError", evalue="no such coefficient", traceback=[])
FINE = new_output("stream", text="fine")


@pytest.mark.parametrize("below, inside, count", [([], [ERROR], 1), ([ERROR], [], 1), ([FINE], [FINE], 0)])
def test_errors_below_a_cell_and_inside_a_widget_are_found(below, inside, count):
    model = {"model_name": "OutputModel", "state": {"outputs": inside}}
    states = {"application/vnd.jupyter.widget-state+json": {"state": {"some-model": model}}}
    notebook = new_notebook(cells=[new_code_cell("1", outputs=below)], metadata={"widgets": states})
    assert errors_in(notebook) == ["ValueError: no such coefficient"] * count


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A small tree with two executed pages: (its root, the pages that a build would execute now)."""
    pages = "book/one.ipynb", "book/two.ipynb", "book/three.md"
    code = "book/qcbook/cells.py", "qclearn/nets/weights.safetensors", "tests/test_one.py"
    for name in (*pages, *code, "constraints.txt", "book/paper.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    monkeypatch.setattr(execute_pages, "ROOT", tmp_path)
    monkeypatch.setattr(execute_pages, "SOURCE", tmp_path / "build" / "book")
    monkeypatch.setattr(execute_pages, "STAMPS", tmp_path / "build" / "book" / ".stamps.json")
    for name in ("execute", "each_page"):
        monkeypatch.setattr(execute_pages, name, lambda *arguments: set())
    execute_pages.execute_outdated(["one", "two"], 2)
    stamps = json.loads((tmp_path / "build/book/.stamps.json").read_text())
    return tmp_path, lambda: [page for page in ("one", "two") if stamps.get(page) != execute_pages.stamp(page)]


OLD = {"tests/test_one.py": [], "book/three.md": [], "book/one.ipynb": ["one"]}
ALL = "book/qcbook/cells.py", "qclearn/nets/weights.safetensors", "qclearn/new.py", "book/paper.toml", "constraints.txt"


@pytest.mark.parametrize("file, expected", [*OLD.items(), *((name, ["one", "two"]) for name in ALL)])
def test_pages_that_are_out_of_date_are_executed_alone(tree, monkeypatch, file, expected):
    root, outdated = tree
    assert outdated() == []
    (root / file).write_text("changed")
    assert outdated() == expected
    ran = []
    monkeypatch.setattr(execute_pages, "run", lambda pages, jobs: ran.append(pages))
    execute_pages.execute_outdated(["one", "two"], 2)
    assert ran == [expected] * bool(expected)


def test_runs_stay_and_all_else_is_copied_anew(tree, monkeypatch):
    root, _ = tree
    (root / "build/book/two.ipynb").write_text("a run")
    for name in ("book/one.ipynb", "book/three.md"):
        (root / name).unlink()
    execute_pages.execute_outdated(["two"], 2)  # executes no page, which would be written
    left = {path.name for path in (root / "build/book").iterdir()}
    assert left == {"two.ipynb", "paper.toml", ".stamps.json"}
    assert (root / "build/book/two.ipynb").read_text() == "a run"


@pytest.mark.parametrize("step", ["prepare", "execute", "finish"])
def test_only_a_page_that_fails_is_left_without_stamp(tree, monkeypatch, step):
    """A page that cannot be prepared stops the run before any is executed."""
    root, _ = tree
    for name in ("one", "two"):
        (root / f"book/{name}.ipynb").write_text("changed")

    def each_page(paths, change):
        at_fault = change is getattr(execute_pages, step) and any(path.stem == "one" for path in paths)
        return ["one.ipynb, cell 1: wrong"] if at_fault else []

    monkeypatch.setattr(execute_pages, "each_page", each_page)
    monkeypatch.setattr(execute_pages, "execute", lambda *arguments: {"one"} if step == "execute" else set())
    with pytest.raises(SystemExit, match="a notebook failed" if step == "execute" else "one.ipynb, cell 1: wrong"):
        execute_pages.execute_outdated(["one", "two"], 2)
    stamps = json.loads((root / "build/book/.stamps.json").read_text())
    assert list(stamps) == ([] if step == "prepare" else ["two"])


def test_the_build_stops_with_page_and_cell(tmp_path):
    with pytest.raises(SystemExit, match="no such page in book/: nowhere.ipynb"):
        execute_pages.copy_pages(["nowhere"])
    path = tmp_path / "page.ipynb"
    execute_pages.nbformat.write(new_notebook(cells=[new_code_cell("1")]), path)
    with pytest.raises(SystemExit, match="page.ipynb, cell 1: wrong"):
        execute_pages.stop_at(execute_pages.each_page([path], lambda notebook: ["cell 1: wrong"]))
    execute_pages.stop_at(execute_pages.each_page([path], lambda notebook: []))
