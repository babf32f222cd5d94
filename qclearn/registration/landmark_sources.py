"""Where the curves of `qclearn landmarks` come from: a label's vertices or a table's points, put in
order, and fsaverage5's curves, carried over."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components, dijkstra

from ..io.fsaverage import fsaverage5, named_sulci
from ..plane.disk import Disk
from ..surfaces.checks import counted, norms
from ..surfaces.conformal import parameterize
from ..surfaces.units import size_of
from .curves import (
    SAMPLES,
    curve_distance,
    edge_graph,
    fundus_metric,
    fundus_path,
    sample_curve,
    walk_back,
    weigh_edges,
)
from .diagnose import diagnose_landmarks, with_folds
from .pair import SurfacePair, align_disks
from .problem import LandmarkError
from .register import register

# How far members of a set may lie beside the path through it: in parts of its length or in edges,
# whichever is more, and never farther than the last part of its length.
BESIDE = 0.1
EDGES = 2.0
AT_MOST = 1 / 3
HEMISPHERES = ("left", "right")


def ordered(surface, vertices):
    """The path (k,) through an unordered set of vertices (n,), between its two ends: those farthest
    apart along edges of the set. LandmarkError where the set is too small, in pieces, or no curve:
    filled, branching, or a ring."""
    vertices = np.unique(vertices)
    if len(vertices) < 2:
        raise LandmarkError(
            f"{counted(vertices, 'vertex', 'vertices')} on this surface, where a curve has two or "
            "more"
        )
    whole = edge_graph(surface, weigh_edges(surface, np.ones(len(surface.vertices))))
    graph = whole[vertices][:, vertices]
    pieces, piece = connected_components(graph, directed=False)
    if pieces > 1:
        sizes = ", ".join(map(str, sorted(np.bincount(piece), reverse=True)[:5]))
        raise LandmarkError(
            f"in {pieces} pieces (of {sizes} vertices): join them, or give each a name of its own"
        )
    first = dijkstra(graph, directed=False, indices=0).argmax()
    along, previous = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    path = walk_back(previous, along.argmax())
    length = along.max()
    beside = dijkstra(graph, directed=False, indices=path, min_only=True).max()
    if beside > min(max(BESIDE * length, EDGES * graph.data.mean()), AT_MOST * length):
        raise LandmarkError(
            f"no curve: its {len(vertices)} vertices reach {beside:.1f} mm beside a path of "
            f"{length:.1f} mm, as a filled region, a branching set or a ring does; draw a line "
            "along the sulcus"
        )
    return vertices[path]


def threaded(surface, vertices):
    """The path through vertices (n,) in their order, by shortest paths in `fundus_metric`; two stay
    as they are."""
    if len(vertices) == 2:
        return vertices
    metric = fundus_metric(surface)
    parts = [
        fundus_path(surface, *pair, metric)[1:] for pair in pairwise(vertices) if pair[0] != pair[1]
    ]
    return np.concatenate([vertices[:1], *parts])


def pair_by_folds(moving, control):
    """The `SurfacePair` of two surfaces, the moving disk aligned to the control's by depth and
    curvature alone; LandmarkError where the mirrored one fits better."""
    pair = SurfacePair(parameterize(moving), parameterize(control), [], [])
    pair = align_disks(with_folds(pair))
    if messages := diagnose_landmarks(pair):
        raise LandmarkError(messages[0])
    return pair


def ends_apart(pair, path, target):
    """Mean distance in mm of a moving path's ends, where an aligned pair takes them, from a control
    path's: as both paths run, and with one of them reversed."""
    here = pair.control.lift(pair.moving.disk.z[path[[0, -1]]])
    there = pair.control.surface.vertices[target[[0, -1]]]
    mm = size_of(pair.control.surface).mm
    return tuple(norms(here - one).mean() / mm for one in (there, there[::-1]))


class Carried(NamedTuple):
    """fsaverage5's curves on a surface. ends: name -> (start, end); off: name -> mean distance in
    mm between the curve as carried and the fundus between these ends, None on fsaverage5;
    hemisphere: whose curves they are."""

    ends: dict
    off: dict
    hemisphere: str


def carried(surface, hemisphere=None):
    """fsaverage5's named curves on a surface, `Carried`, by registering fsaverage5's hemisphere to
    it by folds alone; where it is not given, the one whose depth agrees better. LandmarkError where
    the registration is suspect."""
    templates = {name: fsaverage5(name) for name in HEMISPHERES}
    own = [
        name
        for name, template in templates.items()
        if np.array_equal(template.faces, surface.faces)
    ]
    if own:
        ends = named_sulci(own[0], templates[own[0]].original_vertices)
        return Carried(ends, dict.fromkeys(ends), own[0])
    runs = {
        name: register(templates[name], surface, [])
        for name in ([hemisphere] if hemisphere else HEMISPHERES)
    }
    # With the folds of the wrong hand nothing is fitted: then there is no correlation.
    hemisphere = max(runs, key=lambda name: runs[name].report["r"].get("depth", (-1, -1))[1])
    run = runs[hemisphere]
    template = templates[hemisphere]
    if run.report["suspect"]:
        raise LandmarkError(
            f"fsaverage5's {hemisphere} hemisphere does not fit: {'; '.join(run.report['suspect'])}"
        )
    # The ends go to the nearest corners; the curves between them are compared with fundi there.
    face, weights = Disk(run.disk_control, run.faces_control).locate(run.disk_map)
    nearest = run.faces_control[face, weights.argmax(1)]
    metric_there = fundus_metric(template)
    metric = fundus_metric(surface)
    ends = {}
    off = {}
    for name, pair in named_sulci(hemisphere, template.original_vertices).items():
        ends[name] = tuple(nearest[list(pair)].tolist())
        path = fundus_path(template, *pair, metric_there)
        fundus = fundus_path(surface, *ends[name], metric)
        line = sample_curve(template, path, SAMPLES) @ run.points
        target = sample_curve(surface, fundus, SAMPLES) @ surface.vertices
        off[name] = float(curve_distance(line, target) / size_of(surface).mm)
    return Carried(ends, off, hemisphere)
