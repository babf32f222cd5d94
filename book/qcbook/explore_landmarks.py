"""The explorable of a sulcus between two endpoints: what Python knows of it."""

import json
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from qclearn.plot import curves_plot, disk_plot
from qclearn.registration.curves import CURVATURE_WEIGHT, DEPTH_WEIGHT, fundus_cost, fundus_path, weigh_edges
from qclearn.surfaces.curvature import area_radius, grey_levels, mean_curvature, sulcal_depth

from .examples import CORTICES, cortices
from .live import Live
from .livefiles import hemisphere_file

SULCI = (  # of all surfaces
    "central sulcus",
    "sylvian fissure",
    "superior temporal sulcus",
    "calcarine sulcus",
    "parieto-occipital sulcus",
    "intraparietal sulcus",
    "cingulate sulcus",
    "superior frontal sulcus",
)


def fundus_terms(surface):
    """The terms of `fundus_cost`, limited: curvature (V,) and depth (V,); and the depth's unit in
    mm."""
    curved, deep = mean_curvature(surface), sulcal_depth(surface)
    curvature, depth = (np.log(fundus_cost(surface, curved, *weights)) for weights in ((1, 0), (0, -1)))
    return curvature, depth, float(np.percentile(deep, 95) or deep.max() or 1.0)


class Landmarks(Live):
    """The path along a sulcus' floor between two endpoints, and LD-Net's, of the chapter on LD-Net."""

    page = "landmarks"
    initial = MappingProxyType(
        {
            "hemisphere": "first",
            "sulcus": 0,
            "ends": {},
            "curvature": CURVATURE_WEIGHT,
            "depth": DEPTH_WEIGHT,
            "shortest": True,
            "network": True,
            "truth": True,
        }
    )

    def files(self):
        """The moving surfaces, each with its sulci's ends, LD-Net's curves between them, and the
        true ones."""
        listed, files = {}, {}
        for name in CORTICES:
            pair, file = cortices(name), f"moving-{name}.bin"
            curvature, depth, deep = fundus_terms(pair.moving.surface)
            files[file] = hemisphere_file(pair.moving, curvature=curvature, depth=depth, deep=deep)
            order = [pair.names.index(sulcus) for sulcus in SULCI]
            listed[name] = {"file": file, "order": order, **self.curves(pair, [pair.paths[0][k] for k in order])}
        return files | {"landmarks.json": json.dumps(listed).encode()}

    @staticmethod
    def curves(pair, paths):
        """The sulci with floors `paths` on the moving side of `Courses`, as the browser reads them."""
        from qclearn.nets import load  # here, as it needs torch

        ends = np.array([[path[0], path[-1]] for path in paths])
        surface, z = pair.moving.surface, pair.moving.disk.z
        vertex = {place: v for v, place in enumerate(z.tolist())}
        found = load("ldnet").detect(surface, z, ends)
        network = [[vertex[place] for place in line.tolist()] for line in found]
        truth = [np.asarray(path).tolist() for path in paths] if surface.curves else None
        return {"names": SULCI, "ends": ends.tolist(), "network": network, "truth": truth}

    def ends(self, state):
        """The two vertices between which a state's path runs."""
        pair = cortices(state["hemisphere"])
        path = pair.paths[0][pair.names.index(SULCI[int(state["sulcus"])])]
        return [int(state["ends"].get(str(k), path[-k])) for k in (0, 1)]

    def path(self, state):
        """The shortest path's vertices and length in the metric with a state's weights."""
        surface = cortices(state["hemisphere"]).moving.surface
        cost = fundus_cost(surface, mean_curvature(surface), state["curvature"], state["depth"])
        metric = weigh_edges(surface, cost)
        path = fundus_path(surface, *self.ends(state), metric)
        edge = {tuple(pair): length for pair, length in zip(surface.edges.tolist(), metric)}
        return path, sum(edge[min(pair), max(pair)] for pair in pairwise(path.tolist()))

    def answer(self, state):
        """The library's path between the ends, and what it costs."""
        path, cost = self.path(state)
        return {"path": path.tolist(), "cost": cost}

    def picture(self, state):
        """A Matplotlib figure of the curvature on the disk with the path along the floor, and a
        description."""
        pair, (path, _) = cortices(state["hemisphere"]), self.path(state)
        surface, z, figure = pair.moving.surface, pair.moving.disk.z, Figure(figsize=(4.6, 4.6))
        radius, ax = area_radius(surface, z), figure.subplots()
        shades = grey_levels(mean_curvature(surface), surface.vertex_areas)
        disk_plot(ax, radius.to_image(z), surface.faces, shades, "gray", -80, 335)
        curves_plot(ax, [radius.to_image(z[path])], "detected")
        name = SULCI[int(state["sulcus"])]
        return (figure, f"The curvature of {pair.name} on the disk, and the path along the floor of the {name}.")
