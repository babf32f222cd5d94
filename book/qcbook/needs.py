"""Which page of the book needs which, from one file, as a picture."""

import tomllib
from graphlib import CycleError, TopologicalSorter
from importlib.resources import files

from matplotlib.figure import Figure

from .diagrams import block_diagram


def needs(part="needs"):
    """page -> the pages that it needs, of needs.toml; or with "place" where the picture has it."""
    return tomllib.loads(files(__package__).joinpath("needs.toml").read_text(encoding="utf-8"))[part]


def steps_to(needs):
    """page -> how many pages stand before it at least, one after the other; ValueError names a
    circle or a page that is not listed."""
    if missing := {page for needed in needs.values() for page in needed} - set(needs):
        raise ValueError(f"needs.toml: {', '.join(sorted(missing))} needed, and not listed; give each page a line")
    try:
        order = list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise ValueError(f"needs.toml: pages need each other in a circle: {' <- '.join(error.args[1])}") from None
    found = {}
    for page in order:
        found[page] = 1 + max((found[needed] for needed in needs[page]), default=-1)
    return found


def needs_figure():
    """A Matplotlib figure of `needs`: an arrow leads from a page to one that needs it."""
    listed, place = needs(), needs("place")
    step = steps_to(listed)
    boxes = {page: (place[page], -0.8 * step[page], page, "grey") for page in listed}
    figure = Figure(figsize=(9, 10.5))
    ax = figure.add_axes((0, 0, 1, 1))
    block_diagram(ax, boxes, [(needed, page) for page, many in listed.items() for needed in many])
    return figure
