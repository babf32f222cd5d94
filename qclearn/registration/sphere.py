"""The moving hemisphere, whole, on the control's sphere: what Workbench and FreeSurfer resample through."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..plane.disk import Disk
from ..plane.linear import Dirichlet, assemble
from ..surfaces.checks import norms
from ..surfaces.surface import Surface, SurfaceError
from ..surfaces.untangling import untangled

ROUND = 1.001  # the largest radius by the smallest that a sphere may have, as Workbench wants it
RINGS = 4  # of the cortex that are told apart, its rim the first


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
    def rings(self):
        """How far from the wall each vertex lies (V,): 0 on it, 1 on its rim, and so on up to RINGS + 1."""
        rings = np.full(self.count, RINGS + 1)
        rings[np.setdiff1d(self.wall[0], self.rim)] = 0
        rings[self.rim] = 1
        for ring in range(1, RINGS):
            touched = self.faces[(rings[self.faces] == ring).any(1)]
            rings[touched] = np.minimum(rings[touched], ring + 1)
        return rings


class RegisteredSphere(NamedTuple):
    """A whole hemisphere on a sphere: the `surface` (V vertices), the numbers `moved` (k,) of the vertices that
    untangling moved, and `rings` (V,), how far each lies from the wall: 0 on it, 1 on its rim, at most RINGS + 1."""

    surface: Surface
    moved: np.ndarray
    rings: np.ndarray


def registered_sphere(maps: dict, sphere: Surface) -> RegisteredSphere:
    """The whole moving hemisphere on the control's whole `sphere`, scaled to radius 100, in coordinates of float32.

    maps: the arrays of `read_registration`. The cortex goes by the disk map and the control's triangles. Both walls are
    laid into one disk (Tutte), each vertex of the rim at the length along the control's rim where the cortex puts it,
    and go by the control's triangles there. Faces follow their vertices, outward; what is then flipped or too small is
    `untangled`. SurfaceError where the registration does not hold both surfaces whole, or the sphere is not the
    control's; UntanglingError.
    """
    moving, control = whole_of(maps, "moving"), whole_of(maps, "control")
    unit = unit_sphere(sphere, control.faces)
    places = control.disk.locate(drawn_in(moving.disk.z, control.disk.z[control.disk.loop]))
    points = np.empty((moving.count, 3))
    points[moving.table] = control.disk.interpolate(unit[control.table], places)
    angles = np.zeros(len(control.table), complex)
    angles[control.disk.loop] = np.exp(-1j * around(unit[control.rim]))  # seen from the wall the rim runs clockwise
    there = control.wall_disk(angles[control.disk.loop])
    here = moving.wall_disk(control.disk.interpolate(angles, places)[moving.disk.loop])
    inner = ~np.isin(moving.wall[0], moving.rim)
    points[moving.wall[0][inner]] = there.interpolate(unit[control.wall[0]], there.locate(here.z[inner]))
    points, moved = untangled(points, moving.faces, moving.rings)
    return RegisteredSphere(Surface(points, moving.faces), moved, moving.rings)


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
    table, faces = (maps.get(f"{name}_{side}") for name in ("table", "whole_faces"))
    require_whole(side, table, faces)
    table, faces = table.astype(np.int64), faces.astype(np.int64)
    disk = Disk(maps["disk_map" if side == "moving" else "disk_control"], maps[f"faces_{side}"])
    turned = not alike(table[disk.faces[0]], faces)  # it was mirrored
    return Whole(faces[:, ::-1] if turned else faces, disk, table)


def require_whole(side, table, faces):
    """SurfaceError unless the table (V,) of a registered side and its whole surface's faces (F, 3) are known, and that
    surface is closed and without handles."""
    if table is None or faces is None:
        option = "--cortex" if side == "moving" else "--control-cortex"
        raise SurfaceError(
            f"the whole {side} surface is not known, and a sphere needs its medial wall: run `qclearn register` with "
            f"the whole surface and {option}, or with the npz that `qclearn open` writes"
        )
    count = faces.max() + 1
    if len(faces) != 2 * count - 4:
        raise SurfaceError(
            f"the whole {side} surface is no sphere ({count} vertices, {len(faces)} faces): it has a boundary or "
            "handles; repair the topology where it was made (FreeSurfer: mris_fix_topology)"
        )


def alike(face, faces):
    """Whether one face (3,) runs the same way round among `faces` (F, 3)."""
    same = faces[(np.sort(faces, axis=1) == np.sort(face)).all(1)][0]
    return any(np.array_equal(np.roll(same, turn), face) for turn in range(3))


def keys(faces, count):
    """A number for each face (F, 3) of a mesh of `count` vertices, whatever the order of its corners."""
    low, middle, high = np.sort(faces, axis=1).T
    return (low * count + middle) * count + high


def unit_sphere(sphere, faces):
    """The vertices (V, 3) of a sphere that shall have these `faces` (F, 3), at radius 1; SurfaceError where it has
    others, is no sphere around 0, or looks inward."""
    count = int(faces.max()) + 1
    if (len(sphere.vertices), len(sphere.faces)) != (count, len(faces)):
        raise SurfaceError(
            f"{len(sphere.vertices)} vertices and {len(sphere.faces)} faces, where the control has {count} and "
            f"{len(faces)}: the sphere of another subject; give the control's own"
        )
    if not np.array_equal(*(np.sort(keys(mesh.astype(np.int64), count)) for mesh in (faces, sphere.faces))):
        raise SurfaceError("its faces are not the control's: the sphere of another subject; give the control's own")
    radii = norms(sphere.vertices)
    if not radii.max() < ROUND * radii.min():
        raise SurfaceError(no_sphere(sphere.vertices, radii))
    if sphere.volume < 0:
        raise SurfaceError(
            "the sphere looks inward: its faces are reversed, or it is mirrored, as one of the other hemisphere; give "
            "the control's own as FreeSurfer wrote it"
        )
    if not alike(sphere.faces[0], faces):
        raise SurfaceError(
            "its faces run the other way round than the control's: it is of the other hemisphere, or mirrored; give "
            "the control's own"
        )
    return sphere.vertices / radii[:, None]


def no_sphere(vertices, radii):
    """Why vertices (V, 3) at distances `radii` (V,) from 0 are no sphere around it, in words."""
    centre = np.linalg.lstsq(np.column_stack([2 * vertices, np.ones(len(vertices))]), radii**2)[0][:3]
    off = norms(vertices - centre)
    if off.max() <= ROUND * off.min():
        place = ", ".join(f"{x:.1f}" for x in centre.round(1) + 0.0)  # no -0.0
        return (
            f"a sphere around ({place}), where Workbench and FreeSurfer need one around 0; give it as FreeSurfer wrote "
            "it (mris_convert --to-scanner moves it)"
        )
    return (
        f"not a sphere: its vertices lie {radii.min():.4g} to {radii.max():.4g} from 0; give lh.sphere or "
        "lh.sphere.reg of the control (lh.inflated is none)"
    )
