"""Docstrings and help texts reach the reference pages as they are written."""

from qcbook.sphinxpages import escape_text


def test_text_is_escaped_and_code_and_the_lines_of_sphinx_click_stay():
    lines = ["Weight of |mu|, `f_z` and curve_<name>.", ".. option:: --to <to>", "    **Required** x * y", "| a_b", ""]
    escape_text("app", "context", lines)
    assert lines == [
        r"Weight of \|mu\|, ``f_z`` and curve\_<name>.",
        ".. option:: --to <to>",
        r"    **Required** x \* y",
        "| a_b",
        "",
    ]
