"""Take everything out of the pages and slides of book/ that a run or JupyterLab left in them: outputs, counts,
answers, widgets."""

from pathlib import Path

import nbformat

BOOK = Path(__file__).resolve().parents[2] / "book"


def clear(notebook):
    notebook.metadata.pop("widgets", None)
    for cell in notebook.cells:
        for trace in ("user_expressions", "execution", "collapsed", "scrolled"):
            cell.metadata.pop(trace, None)
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None


def main():
    for path in sorted([*BOOK.glob("*.ipynb"), *BOOK.glob("decks/*.ipynb")]):
        before = path.read_text(encoding="utf-8")
        notebook = nbformat.reads(before, as_version=4)
        clear(notebook)
        if (after := nbformat.writes(notebook) + "\n") != before:
            path.write_text(after, encoding="utf-8")
            print(f"cleared: book/{path.relative_to(BOOK)}")


if __name__ == "__main__":
    main()
