"""Block diagrams: arrows run from box to box and stop at their edges."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from qcbook.diagrams import block_diagram


@pytest.mark.parametrize("dpi", [100, 200])
def test_an_arrow_stops_at_the_edges_of_its_boxes(dpi):
    figure = Figure(figsize=(6, 3), dpi=dpi)
    FigureCanvasAgg(figure)
    boxes = {"a": (0, 0, "a", "grey"), "b": (3, 1, "a wide\nbox", "blue")}
    texts, [arrow] = block_diagram(figure.subplots(), boxes, [("a", "b")])
    figure.canvas.draw()
    path = arrow.arrow_patch.get_path().vertices
    ends = arrow.arrow_patch.get_transform().transform(path[[0, 2]])
    for text, end in zip(texts.values(), ends):
        box = text.get_bbox_patch().get_window_extent()
        away = max(box.x0 - end[0], end[0] - box.x1, box.y0 - end[1], end[1] - box.y1)
        assert -3 * dpi / 100 < away < 6 * dpi / 100
    assert np.all(ends[0] < ends[1])
