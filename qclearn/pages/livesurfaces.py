"""Explorables of cortical surfaces: the registered sulci in 3-D; what the browser gets of a surface."""

import json
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure
from scipy import sparse

from ..plane.diskmesh import sampling_matrix
from ..registration.fit import fit_problem
from ..registration.landmarks import (
    CURVATURE_WEIGHT,
    DEPTH_WEIGHT,
    fundus_cost,
    fundus_path,
    sample_curve,
    weigh_edges,
)
from ..registration.metrics import measured_losses
from ..registration.register import load
from ..registration.transfer import lift
from ..surfaces.curvature import area_radius, grey_levels, mean_curvature, sulcal_depth
from ..surfaces.surface import Surface
from .examples import CORTICES, cortices, paired_problem
from .live import Live, as_pairs, loops
from .livenets import packed
from .liveproblems import as_moved, problems_file, weights_of
from .plot import curves_plot, disk_plot
from .scenes import surface_picture

LINE = 25  # points of a drawn sulcus
SULCI = (
    "central sulcus",
    "sylvian fissure",
    "superior temporal sulcus",
    "calcarine sulcus",
    "parieto-occipital sulcus",
    "intraparietal sulcus",
    "cingulate sulcus",
    "superior frontal sulcus",
)  # that all surfaces have
POINTS = 5  # of a curve in the tuner
UNFOLDING = 150  # rounds of averaging over neighbours, as in unfold.js
STEPS = 2**16 - 1  # of a number that travels in two bytes


def hemisphere_file(surface, z, **values):
    """A surface with its disk map z as `Hemisphere` of hemisphere.js reads it.

    Positions in mm, places in the disk with a radius that follows the area, and values per vertex are rounded to one
    part in 65,535 of their range; numbers go as they are. shade: grey levels from 0 (sulci) to 255 (gyri).
    """
    radius = area_radius(surface, z)
    w = radius.to_image(z)
    plain = {name: value for name, value in values.items() if np.ndim(value) == 0}
    numbers = {"vertices": surface.vertices, "places": np.stack([w.real, w.imag], -1)} | values
    ranges, arrays = {}, {}
    for name, array in numbers.items():
        if name in plain:
            continue
        low, step = array.min(), np.ptp(array) / STEPS or 1.0
        ranges[name], arrays[name] = [float(low), float(step)], np.round((array - low) / step).astype(np.uint16)
    boundary = surface.vertices[np.concatenate(surface.boundary_loops)]
    config = {
        **plain,
        "ranges": ranges,
        "radius": {"disk": radius.disk.tolist(), "image": radius.image.tolist()},
        "away": (surface.vertices.mean(0) - boundary.mean(0)).tolist(),  # from the opening
    }
    shade = grey_levels(mean_curvature(surface), surface.vertex_areas).round().astype(np.uint8)
    return packed(config, arrays | {"faces": surface.faces.astype(np.uint16), "shade": shade})


def unfolded(surface, rounds=UNFOLDING):
    """Positions (V, 3) after rounds of averaging each vertex with its neighbours, scaled back to the surface's area.

    The rim is averaged along itself, so that the opening stays open. The browser unfolds by itself, by unfold.js.
    """
    count = len(surface.vertices)
    rim = np.isin(np.arange(count), np.concatenate(surface.boundary_loops))
    ends = np.concatenate([surface.edges, surface.edges[:, ::-1]])
    ends = ends[~rim[ends[:, 0]] | rim[ends[:, 1]]]  # what moves a vertex of the rim lies on the rim
    weights = 1 / np.bincount(ends[:, 0], minlength=count)[ends[:, 0]]
    means = sparse.csr_array((weights, tuple(ends.T)), shape=(count, count))
    x = surface.vertices
    for _ in range(rounds):
        x = (x + means @ x) / 2
    middle = x.mean(0)
    corners = x[surface.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    return middle + (x - middle) * np.sqrt(surface.area / area)


def courses_of(pair):
    """Names of the sulci of a `Paired`, and LINE points of each in the disk, for the moving and the control side."""
    lines = ([as_pairs(line.round(5)) for line in side] for side in pair.sampled(LINE))
    return {"names": pair.names, **dict(zip(("moving", "target"), lines))}


def fundus_terms(surface):
    """What `fundus_cost` weighs at each vertex: curvature (V,) and depth (V,), limited; and the depth's unit in mm."""
    curvature, depth = (
        np.log(fundus_cost(surface, mean_curvature(surface), *weights)) for weights in ((1, 0), (0, -1))
    )
    deepest = sulcal_depth(surface).max()
    return curvature, depth, float(np.percentile(sulcal_depth(surface), 95) or deepest or 1.0)


class Sulci(Live):
    """The tuner's map carried to the control surface, of the chapter on registration."""

    page = "sulci"
    initial = MappingProxyType(
        {
            "problem": "cortex",
            "landmarks": "points",
            "alpha": 1.0,
            "beta": 0.01,
            "gamma": 1000.0,
            "turn": 0.0,
            "tilt": 10.0,
            "zoom": 1.0,
            "unfold": 0.6,
            "before": False,
            "starts": {},
            "targets": {},
        }
    )
    mesh = 24, 72

    def files(self):
        """The inner loops in WebAssembly, the problems, the courses of the sulci, and the control surfaces."""
        pairs = {name: cortices(name) for name in CORTICES}
        # The synthetic subjects have one control.
        surfaces = {name: f"control-{'cortex' if name == 'cortex' else 'subject'}.bin" for name in CORTICES}
        controls = {file: pairs[name] for name, file in surfaces.items()}
        courses = {
            name: {
                "control": surfaces[name],
                "names": pair.names,
                **dict(
                    zip(
                        ("moving", "target"),
                        [[as_pairs(line.round(5)) for line in side] for side in pair.sampled(LINE)],
                    )
                ),
            }
            for name, pair in pairs.items()
        }
        return {
            **loops(),
            "problems.json": problems_file(),
            "sulci.json": json.dumps(courses).encode(),
            **{file: hemisphere_file(pair.control, pair.z_control) for file, pair in controls.items()},
        }

    def fit(self, state):
        """The problem as the reader has changed it, and the library's fit."""
        problem = as_moved(paired_problem(cortices(state["problem"])).problem, state, self.mesh)
        return problem, fit_problem(problem, weights_of(state), rings=self.mesh[0])

    def answer(self, state):
        """The library's fit: its map, L_CP, and how far the registered landmarks are from their targets in mm."""
        problem, fit = self.fit(state)
        losses = measured_losses(problem, weights_of(state), fit.mu, problem.samples @ fit.f)
        return {"map": as_pairs(fit.f), "L_CP": losses["L_CP"], "mm": self.distances(state, problem, fit.f).mean()}

    @staticmethod
    def distances(state, problem, f):
        """Distance in space (M,) of each landmark on the control surface from its target, in mm."""
        pair = cortices(state["problem"])
        ends = (lift(pair.control, pair.z_control, points) for points in (problem.samples @ f, problem.target))
        return np.linalg.norm(np.subtract(*ends), axis=1)

    def read(self, name, state, found):
        """map (V,): the map at the vertices of the mesh; mm: mean distance of landmarks from their targets."""
        if name == "mm" and "mm" in found:
            return found["mm"]
        return super().read(name, state, found)

    def picture(self, state):
        """A photograph of the unfolded control surface with the registered curves, and a description."""
        pair, (problem, fit) = cortices(state["problem"]), self.fit(state)
        moving, targets = pair.sampled(LINE)
        shape = Surface(unfolded(pair.control), pair.control.faces)
        ends = np.cumsum([len(line) for line in moving])[:-1]
        carried = np.split(sampling_matrix(problem.z, problem.faces, np.concatenate(moving)) @ fit.f, ends)
        curves = [
            (lift(shape, pair.z_control, line), style)
            for lines, style in ((targets, "target"), (carried, "registered"))
            for line in lines
        ]
        shades = grey_levels(mean_curvature(pair.control), pair.control.vertex_areas)
        figure = Figure(figsize=(6.4, 4.3), dpi=50)  # a photograph: twice the dots would be a megabyte
        figure.add_axes((0, 0, 1, 1)).imshow(surface_picture(shape, shades, curves=curves))
        figure.axes[0].axis("off")
        return figure, (
            f"The unfolded control surface of {pair.name}: registered sulci yellow, their targets red, on average "
            f"{self.distances(state, problem, fit.f).mean():.1f} mm apart."
        )


class Landmarks(Live):
    """Two endpoints, the path along the floor of the sulcus between them, and LD-Net's, of the chapter on LD-Net."""

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
        """The moving surfaces, and for each the sulci's ends, LD-Net's curves between them, and the true ones."""
        listed, files = {}, {}
        for name in CORTICES:
            pair, file = cortices(name), f"moving-{name}.bin"
            curvature, depth, deep = fundus_terms(pair.moving)
            files[file] = hemisphere_file(pair.moving, pair.z_moving, curvature=curvature, depth=depth, deep=deep)
            order = [pair.names.index(sulcus) for sulcus in SULCI]
            listed[name] = {"file": file, "order": order, **self.curves(pair, [pair.paths[0][k] for k in order])}
        return files | {"landmarks.json": json.dumps(listed).encode()}

    @staticmethod
    def curves(pair, paths):
        """What the browser is told of the sulci of a `Paired`'s moving surface, whose floors are `paths`."""
        ends = np.array([[path[0], path[-1]] for path in paths])
        vertex = {place: v for v, place in enumerate(pair.z_moving.tolist())}
        found = load("ldnet").detect(pair.moving, pair.z_moving, ends)
        network = [[vertex[place] for place in line.tolist()] for line in found]
        truth = [np.asarray(path).tolist() for path in paths] if pair.moving.curves else None
        return {"names": SULCI, "ends": ends.tolist(), "network": network, "truth": truth}

    def ends(self, state):
        """The two vertices between which a state's path runs."""
        pair = cortices(state["hemisphere"])
        path = pair.paths[0][pair.names.index(SULCI[int(state["sulcus"])])]
        return [int(state["ends"].get(str(k), path[-k])) for k in (0, 1)]

    def path(self, state):
        """Vertices of the shortest path in the metric with a state's weights, and its length in that metric."""
        surface = cortices(state["hemisphere"]).moving
        cost = fundus_cost(surface, mean_curvature(surface), state["curvature"], state["depth"])
        metric = weigh_edges(surface, cost)
        path = fundus_path(surface, *self.ends(state), metric)
        edge = {tuple(pair): length for pair, length in zip(surface.edges.tolist(), metric)}
        return path, sum(edge[min(pair), max(pair)] for pair in pairwise(path.tolist()))

    def answer(self, state):
        """The library's path between the ends, and what it costs."""
        path, cost = self.path(state)
        return {"path": path.tolist(), "cost": cost}

    def read(self, name, state, found):
        """path: vertices of the path along the floor; curve (5,) complex: its points in the tuner's disk; starts: these
        as the tuner's `starts` has them."""
        pair = cortices(state["hemisphere"])
        if name == "path" and "path" in found:
            return np.array(found["path"])
        if name == "curve":
            return sample_curve(pair.moving, self.read("path", state, found), POINTS) @ pair.z_moving
        if name == "starts":
            first = POINTS * pair.names.index(SULCI[int(state["sulcus"])])
            return {str(first + k): point for k, point in enumerate(as_pairs(self.read("curve", state, found)))}
        return super().read(name, state, found)

    def picture(self, state):
        """A Matplotlib figure of the curvature on the disk with the path along the floor, and a description."""
        pair, (path, _) = cortices(state["hemisphere"]), self.path(state)
        radius, figure = area_radius(pair.moving, pair.z_moving), Figure(figsize=(4.6, 4.6))
        ax, shades = figure.subplots(), grey_levels(mean_curvature(pair.moving), pair.moving.vertex_areas)
        disk_plot(ax, radius.to_image(pair.z_moving), pair.moving.faces, shades, "gray", -80, 335)
        curves_plot(ax, [radius.to_image(pair.z_moving[path])], "detected")
        name = SULCI[int(state["sulcus"])]
        return figure, f"The curvature of {pair.name} on the disk, and the path along the floor of the {name}."
