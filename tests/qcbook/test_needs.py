"""Which page needs which: listed once, without a circle, in an order that the contents keep."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.path import Path

from book.builder.references import chapters
from qcbook.needs import needs, needs_figure, steps_to


def test_each_page_is_listed_and_comes_after_what_it_needs():
    order = [page for page in chapters() if page in needs()]
    assert set(order) == set(needs())
    beside = {"index", "notation", "teaching", "projects", "hub", "related", "relatedtools", "datasheet"}
    beside |= {"installation", "commandline", "files", "api"}
    assert set(chapters()) - set(order) == beside | {"glossary", "bibliography"}
    early = [(page, one) for page, many in needs().items() for one in many if order.index(one) > order.index(page)]
    assert early == []


def test_a_circle_and_an_unknown_page_are_found():
    with pytest.raises(ValueError, match="in a circle: "):
        steps_to(needs() | {"lbs": ["benchmark"]})
    with pytest.raises(ValueError, match="nowhere needed, and not listed"):
        steps_to(needs() | {"lbs": ["nowhere"]})
    assert steps_to({"a": [], "b": ["a"], "c": ["a", "b"]}) == {"a": 0, "b": 1, "c": 2}


def test_the_picture_has_each_page_and_each_arrow():
    (ax,) = needs_figure().axes
    words = {text.get_text() for text in ax.texts} - {""}
    assert words == set(needs())
    assert sum(text.get_text() == "" for text in ax.texts) == sum(map(len, needs().values()))


def test_no_arrow_runs_through_another_page():
    figure = needs_figure()
    FigureCanvasAgg(figure).draw()
    pages = [text for text in figure.axes[0].texts if text.get_text()]
    boxes = {text.get_text(): text.get_bbox_patch().get_window_extent() for text in pages}
    middle = {page: (box.x0 + box.x1, box.y0 + box.y1) for page, box in boxes.items()}
    through = [
        (needed, page, other)
        for page, many in needs().items()
        for needed in many
        for other in set(needs()) - {needed, page}
        if Path(np.array([middle[needed], middle[page]]) / 2).intersects_bbox(boxes[other])
    ]
    assert through == []
