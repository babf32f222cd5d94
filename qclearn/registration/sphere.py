"""The moving hemisphere, whole, on the control's sphere: what Workbench and FreeSurfer resample through."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..plane.disk import Disk
from ..plane.linear import Dirichlet, assemble
from ..surfaces.checks import norms
from ..surfaces.surface import Surface, SurfaceError
from ..surfaces.untangling import RADIUS, untangled

ROUND = 1e-3  # share of the radius that a sphere's vertices may stray, as Workbench has it
RINGS = 4  # of cortex around the wall, the rim one of them, that leave moving to those farther out


@dataclass(frozen=True, eq=False)
class Whole:
    """A whole closed surface by its faces (F, 3), outward where it was registered, and the cortex that was cut out of
    it: the `Disk` of its map, and the numbers `table` (V',) of its vertices in the whole."""

    faces: np.ndarray
    disk: Disk
    table: np.ndarray

    @property
    def count(self):
        return int(self.faces.max()) + 1

    @cached_property
    def rim(self):
        """The cortex's boundary, numbers in the whole."""
        return self.table[self.disk.loop]

    @cached_property
    def wall(self):
        """The vertices (W,) of the faces that are not cortex, sorted, and these faces numbered among them."""
        cortex = keys(self.table[self.disk.faces], self.count)
        rest = self.faces[~np.isin(keys(self.faces, self.count), cortex)]
        vertices, faces = np.unique(rest, return_inverse=True)
        return vertices, faces.reshape(-1, 3)

    def wall_disk(self, angles):
        """The wall as a `Disk`: its rim at `angles` (B,) complex, each inner vertex the mean of its neighbours."""
        vertices, faces = self.wall
        rim, blocks = np.searchsorted(vertices, self.rim), np.broadcast_to(3 * np.eye(3) - 1, (len(faces), 3, 3))
        return Disk(Dirichlet(assemble(faces, blocks, len(vertices)), rim).solve(angles), faces)

    @cached_property
    def rank(self):
        """How far from the wall each vertex lies: 0 on it, 1 on its rim, up to RINGS + 1."""
        rank = np.full(self.count, RINGS + 1)
        rank[np.setdiff1d(self.wall[0], self.rim)] = 0
        rank[self.rim] = 1
        for ring in range(1, RINGS):
            touched = self.faces[(rank[self.faces] == ring).any(1)]
            rank[touched] = np.minimum(rank[touched], ring + 1)
        return rank


def registered_sphere(maps: dict, sphere: Surface) -> tuple[Surface, np.ndarray]:
    """The whole moving hemisphere on the control's whole `sphere`: a closed `Surface` of radius 100, its coordinates
    those of float32, and the vertices (k,) that untangling moved.

    maps: the arrays of `read_registration`. The cortex goes by the disk map and the control's triangles. Both walls are
    laid into one disk (Tutte), each vertex of the rim at the length along the control's rim where the cortex puts it,
    and go by the control's triangles there. Faces follow their vertices; what is flipped or too small then is
    `untangled`. SurfaceError where the registration does not hold both surfaces whole, or `sphere` is not the control's.
    """
    moving, control = whole_of(maps, "moving"), whole_of(maps, "control")
    unit = unit_sphere(sphere, control)
    places = control.disk.locate(drawn_in(moving.disk.z, control.disk.z[control.disk.loop]))
    points = np.empty((moving.count, 3))
    points[moving.table] = control.disk.interpolate(unit[control.table], places)
    angles = np.zeros(len(control.table), complex)
    angles[control.disk.loop] = np.exp(-1j * around(unit[control.rim]))  # seen from the wall the rim runs clockwise
    there = control.wall_disk(angles[control.disk.loop])
    here = moving.wall_disk(control.disk.interpolate(angles, places)[moving.disk.loop])
    inner = ~np.isin(moving.wall[0], moving.rim)
    points[moving.wall[0][inner]] = there.interpolate(unit[control.wall[0]], there.locate(here.z[inner]))
    points, moved = untangled(points, moving.faces, moving.rank)
    return Surface(points, moving.faces), moved


def drawn_in(z, rim):
    """Points z (V,) of the unit disk drawn into the polygon of `rim` (B,) on its circle: by half as much as they come
    nearer to the circle than two times the polygon's side stays away from it. One to one; what is farther in stays."""
    angles = np.sort(np.angle(rim))
    start = np.searchsorted(angles, np.angle(z), side="right") - 1
    half = np.diff(angles, append=angles[0] + 2 * np.pi)[start] / 2
    side = np.cos(half) / np.cos(np.angle(z * np.exp(-1j * (angles[start] + half))))  # how far from 0, at z's angle
    size = abs(z)
    return z * np.minimum(1, (size + 2 * side - 1) / (2 * np.maximum(size, 0.5)))


def around(rim):
    """Angles (B,) from 0 of the points of a closed line (B, 3), by its length."""
    steps = np.cumsum(norms(np.roll(rim, -1, axis=0) - rim))
    return 2 * np.pi * np.r_[0, steps[:-1]] / steps[-1]


def whole_of(maps, side):
    """The `Whole` of the side "moving" or "control" of a registration; SurfaceError where it does not hold one."""
    if f"about_{side}" not in maps:
        raise SurfaceError(
            "written by an older version of this program, without the whole surfaces; run `qclearn register` again"
        )
    if f"table_{side}" not in maps or f"whole_faces_{side}" not in maps:
        option = "--cortex" if side == "moving" else "--control-cortex"
        raise SurfaceError(
            f"the {side} surface was registered as it had been cut open, and a sphere needs the whole one: run "
            f"`qclearn register` with the whole surface and {option}"
        )
    table, faces = (maps[f"{name}_{side}"].astype(np.int64) for name in ("table", "whole_faces"))
    disk = Disk(maps["disk_map" if side == "moving" else "disk_control"], maps[f"faces_{side}"])
    cortex, count = table[disk.faces], int(faces.max()) + 1
    if len(faces) != 2 * count - 4:
        raise SurfaceError(
            f"the whole {side} surface is no sphere ({count} vertices, {len(faces)} faces): it has a boundary or handles; "
            "repair the topology where it was made (FreeSurfer: mris_fix_topology)"
        )
    if not np.isin(keys(cortex, count), keys(faces, count)).all():
        raise SurfaceError(f"its {side} surface is not cut out of the whole one; run `qclearn register` again")
    same = faces[keys(faces, count) == keys(cortex[:1], count)][0]
    turned = not any(np.array_equal(np.roll(same, turn), cortex[0]) for turn in range(3))  # mirrored, or was inside out
    return Whole(faces[:, ::-1] if turned else faces, disk, table)


def keys(faces, count):
    """A number for each face (F, 3) of a mesh of `count` vertices, whatever the order of its corners."""
    low, middle, high = np.sort(faces, axis=1).T
    return (low * count + middle) * count + high


def unit_sphere(sphere, control):
    """The vertices (W, 3) of the sphere of a `Whole`, at radius 1; SurfaceError where it cannot be that one's."""
    if (len(sphere.vertices), len(sphere.faces)) != (control.count, len(control.faces)):
        there, here = (
            f"{n} vertices and {f} faces"
            for n, f in ((len(sphere.vertices), len(sphere.faces)), (control.count, len(control.faces)))
        )
        raise SurfaceError(f"has {there}, and the control {here}; give the sphere of the control itself")
    wanted, found = (np.sort(keys(faces, control.count)) for faces in (control.faces, sphere.faces))
    if not np.array_equal(wanted, found):
        raise SurfaceError(
            "has other faces than the control, so it is another subject's; give the control's own sphere"
        )
    radii = norms(sphere.vertices)
    if np.ptp(radii) > ROUND * radii.max():
        raise SurfaceError(no_sphere(sphere.vertices, radii))
    if sphere.volume < 0:
        raise SurfaceError(
            "looks inward: its faces are reversed, or it is the mirror image of a sphere; give the control's own as it is"
        )
    unit = sphere.vertices / radii[:, None]
    a, b, c = (unit[control.table[corner]] for corner in control.disk.faces.T)
    if np.median(np.einsum("fi,fi->f", a, np.cross(b, c))) < 0:
        raise SurfaceError(
            "runs the other way round than the control: it is the other hemisphere's; give the control's"
        )
    return unit


def no_sphere(vertices, radii):
    """What is wrong with a sphere of these radii (V,), in words: it lies elsewhere, or it is none."""
    centre = np.linalg.lstsq(np.column_stack([2 * vertices, np.ones(len(vertices))]), radii**2)[0][:3]
    off = norms(vertices - centre)
    if np.ptp(off) <= ROUND * off.max():
        place = ", ".join(f"{x:.1f}" for x in centre)
        return (
            f"is a sphere around ({place}), where Workbench and FreeSurfer need one around 0: move it back there "
            "(mris_convert without --to-scanner leaves it where it was)"
        )
    return (
        f"is no sphere: its vertices lie {radii.min():.4g} to {radii.max():.4g} from 0; give lh.sphere or "
        "lh.sphere.reg (lh.inflated is none)"
    )
