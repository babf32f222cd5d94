"""The benchmark's problems on real cortex, where a small landmark error proves little.

"heldout": fsaverage5, either side onto the other, with half of its curves held out. "warp":
fsaverage5's left side or a synthetic one with another mesh, warped in space, onto itself: ground
truth. "conte69": sides that correspond by vertex index and carry held-out maps. "folder": each
person of a folder onto each other, with half of their curves held out.
"""

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from ..io.conte69 import conte69
from ..io.fsaverage import fsaverage5, named_sulci
from ..io.meshes import read_surface
from ..plane.grids import joined
from ..registration.curves import curves_of_both, fundus_metric, fundus_path
from ..surfaces.surface import Surface, mirror
from .pairs import Pair, fsaverage_sphere, fsaverage_surface, mapped

# Of the curves: fitted.
PARTS = {"first half": slice(0, None, 2), "second half": slice(1, None, 2), "all": slice(None)}
HALVES = tuple(PARTS)[:2]
AMPLITUDES = (6.0, 9.0, 12.0)  # of the warps, mm: root mean square over the vertices
BUMPS, WIDTH = 40, 22.0  # number and standard deviation (mm) of the Gaussians of a warp
STRETCH = (1.06, 0.95, 1.0)  # along the axes, after the warp


def fsaverage_side(hemisphere):
    """One side of fsaverage5, the right one mirrored, with its named sulci as curves, `Mapped`."""
    surface = fsaverage_surface(hemisphere)
    ends = named_sulci(hemisphere, surface.original_vertices)
    return mapped(with_curves(surface, ends), fsaverage_sphere(hemisphere))


def with_curves(surface, ends):
    """A surface with the shortest fundus paths between ends, name -> (start, end) vertices."""
    metric = fundus_metric(surface)
    curves = {name: fundus_path(surface, *pair, metric) for name, pair in ends.items()}
    return Surface(surface.vertices, surface.faces, curves)


def heldout_pair(moving, control, part, there_and_back=True):
    """Two sides of a brain, or of two; a part of their curves is fitted, the others are held out."""
    fitted, held = parted(curves_of_both(moving.surface, control.surface), part)
    return Pair(moving, control, fitted, held=held, there_and_back=there_and_back)


def person(path):
    """A person's open hemisphere from its npz, with the curves in it, `Mapped`."""
    return mapped(read_surface(path))


def parted(curves, part):
    """(fitted, held) curves of a part of `PARTS`."""
    fitted = curves[PARTS[part]]
    return tuple(fitted), tuple(curve for curve in curves if curve not in fitted)


def warp_pair(control, amplitude):
    """A surface with another mesh and another shape onto itself: the true map is known."""
    faces, weights, curves = other_mesh(control)
    surface = control.surface
    truth = weights @ surface.vertices
    moving = Surface(warped(truth, amplitude) * STRETCH, faces, curves)
    shared = tuple(curves_of_both(moving, surface))
    return Pair(mapped(moving), control, shared, truth, weights @ control.disk.z)


def other_mesh(control):
    """Another mesh of a `Mapped` surface: faces (G, 3), sparse weights (W, V), curves.

    The weights give its vertices from the old ones. Vertices of boundary and curves stay; the
    centre of a face beside it replaces every other one. Delaunay's faces in the disk, where angles
    are those in space.
    """
    surface, rng = control.surface, np.random.default_rng(0)
    stay = np.unique(np.concatenate([surface.boundary, *surface.curves.values()]))
    order = rng.permutation(len(surface.faces))
    beside = np.empty(len(surface.vertices), int)
    beside[surface.faces[order].ravel()] = np.repeat(order, 3)
    centres = surface.faces[np.unique(np.delete(beside, stay))]
    rows = np.concatenate([np.arange(len(stay)), len(stay) + np.repeat(np.arange(len(centres)), 3)])
    columns = np.concatenate([stay, centres.ravel()])
    values = np.concatenate([np.ones(len(stay)), np.full(centres.size, 1 / 3)])
    shape = len(stay) + len(centres), len(surface.vertices)
    weights = sparse.csr_array((values, (rows, columns)), shape=shape)
    curves = {name: np.searchsorted(stay, path) for name, path in surface.curves.items()}
    return joined(weights @ control.disk.z).faces, weights, curves


def warped(points, amplitude):
    """Points (W, 3) pushed by random Gaussians, `amplitude` mm in root mean square."""
    rng = np.random.default_rng(round(amplitude))
    centres = points[rng.choice(len(points), BUMPS, replace=False)]
    weights = np.exp(-((points[:, None] - centres) ** 2).sum(-1) / (2 * WIDTH**2))
    field = weights @ rng.normal(size=(BUMPS, 3))
    return points + field * amplitude / np.sqrt((field**2).sum(1).mean())


def conte69_sides():
    """conte69's mirrored right and its left side, `Mapped` with sulci, and its maps."""
    brain = conte69()
    sides = []
    # In the same space as fsaverage5: the ends of its curves are the vertices nearest to theirs.
    for hemisphere, surface in (("right", brain.right), ("left", brain.left)):
        template = fsaverage5(hemisphere)
        sulci = named_sulci(hemisphere, template.original_vertices)
        tree = cKDTree(surface.vertices)
        ends = {n: tree.query(template.vertices[list(pair)])[1] for n, pair in sulci.items()}
        surface = surface if hemisphere == "left" else mirror(surface)
        sides.append(mapped(with_curves(surface, ends)))
    return *sides, {name: pair[::-1] for name, pair in brain.maps.items()}


def conte69_pair(sides, part):
    """conte69's mirrored right side onto its left; equal vertex numbers are the ground truth."""
    right, left, maps = sides
    fitted, held = parted(curves_of_both(right.surface, left.surface), part)
    return Pair(right, left, fitted, left.surface.vertices, left.disk.z, held=held, maps=maps)
