"""A registered hemisphere on the control's sphere, and meshes on a sphere untangled: no face
flipped or too small in the float32 that files hold."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Integer
from numpy import ndarray
from scipy import sparse

from ..plane.disk import Disk
from ..plane.linear import Dirichlet, assemble, edge_lengths
from ..surfaces.surface import Surface, SurfaceError

RADIUS = 100.0  # of the spheres of FreeSurfer and of Workbench, mm
# Every edge, mm, and every face, mm^2, has at least this size in the end.
LEAST_EDGE = 1e-3
LEAST_AREA = 1e-5
# A face below BAD times its least size is enlarged to GOOD times of it.
BAD = 1.2
GOOD = 3.0
# Rounds at most; one more ring of vertices may move after each PATIENCE rounds; every EASE rounds
# vertices of a rank below SOFT go to the means of their neighbours.
ROUNDS = 80
PATIENCE = 10
EASE = 4
SOFT = 4
STEP = 0.4  # of the edges around it, or less at random: how far a vertex goes in a round
# Of the next rank's moving 1 mm, and of 1 mm of missing height.
PRICE = 3.0
MISSING = 1e4


class UntanglingError(ValueError):
    """A mesh on a sphere whose flipped faces could not be turned back."""


def untangled(
    vertices: Float[ndarray, " V 3"], faces: Integer[ndarray, " F 3"], rank: Integer[ndarray, " V"]
) -> tuple[Float[ndarray, " V 3"], Integer[ndarray, " k"]]:
    """The vertices of a closed mesh on the sphere of RADIUS without a flipped or too small face;
    and which were moved.

    They are those that float32 holds; the faces look outward. Around bad faces the vertices make in
    each round the shortest moves that give all faces their heights (`least_moves`), those of low
    `rank` rather than others. Where that does not end, those below rank SOFT go to the means of
    their neighbours every EASE rounds: long faces on a jagged seam need a detour. UntanglingError,
    with the faces, where ROUNDS are not enough.
    """
    p = stored(vertices)
    moved = np.zeros(len(vertices), bool)
    rng = np.random.default_rng(0)
    bad = np.flatnonzero(too_small(p, faces))
    for turn in range(ROUNDS):
        if not len(bad):
            return p, np.flatnonzero(moved)
        # The vertices of the bad faces and of rings around them are active.
        near = bad
        for _ in range(2 + turn // PATIENCE):
            active = np.unique(faces[near])
            near = np.flatnonzero(np.isin(faces, active).any(1))
        if turn % EASE == EASE - 1:
            soft = active[rank[active] < SOFT]
            # each goes to the sum of its neighbours, each as often as faces join the two
            pairs = np.broadcast_to(1 - np.eye(3), (len(near), 3, 3))
            p[soft] = stored((assemble(faces[near], pairs, len(p)) @ p)[soft])
            moved[soft] = True
        # Full steps that have not helped by now may go round in circles: then steps are random.
        steps = np.full(len(active), STEP)
        if turn >= EASE:
            steps *= 0.1 ** rng.random(len(active))
        shift = least_moves(p, faces[near], active, rank[active], steps)
        going = active[shift.any(1)]
        p[going] = stored(p[going] + shift[shift.any(1)])
        moved[going] = True
        bad = near[too_small(p, faces[near])]
    raise UntanglingError(
        f"{len(bad)} faces of the sphere stay flipped or too small, the first {bad[:5].tolist()}; "
        "look at the registration there, made without a sphere, and at the cortex labels of both "
        "sides"
    )


def stored(points):
    """Points (n, 3) put on the sphere of RADIUS, as float32 holds them."""
    return (
        (points * (RADIUS / np.linalg.norm(points, axis=1)[:, None]))
        .astype(np.float32)
        .astype(float)
    )


def too_small(p, faces):
    """Which faces are flipped, or too near to the least area or edge, (F,) bool."""
    lengths = edge_lengths(p[faces])
    areas = doubled_areas(p, faces)[0] / 2
    return (areas < BAD * LEAST_AREA) | (lengths.min(1) < BAD * LEAST_EDGE)


def doubled_areas(p, faces):
    """Twice the area of each face, `det(a, b, c) / RADIUS` (F,), negative where it looks inward,
    and its gradient by each corner, (F, 3, 3)."""
    a, b, c = (p[corner] for corner in faces.T)
    gradient = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1) / RADIUS
    return np.einsum("fi,fi->f", a, gradient[:, 0]), gradient


def least_moves(p, faces, active, rank, steps):
    """The moves (k, 3) of the `active` vertices (k,) across the sphere that give the faces (m, 3)
    their heights.

    A linear program: `min sum_v PRICE^rank_v |x_v|_1 + MISSING sum_f s_f`, where the height of each
    face over its longest side, linear in x, is at least what its area and its shortest edge need,
    less s_f >= 0. A vertex goes at most `steps` (k,) times the length of the edges around it. The
    sum of the lengths is least, so that few move.
    """
    n = len(active)
    m = len(faces)
    number = np.full(len(p), -1)
    number[active] = np.arange(n)
    lengths = edge_lengths(p[faces])
    area, gradient = doubled_areas(p, faces)
    longest = np.maximum(lengths.max(1), LEAST_EDGE)
    wanted = GOOD * np.maximum(LEAST_EDGE, 2 * LEAST_AREA / longest)
    # The derivative of each height by both coordinates of its face's active corners.
    axes = across(p[active])
    face, corner = np.nonzero(number[faces] >= 0)
    at = number[faces[face, corner]]
    slopes = np.einsum("ki,kji->kj", gradient[face, corner], axes[at]) / longest[face, None]
    places = np.repeat(face, 2), (2 * at[:, None] + [0, 1]).ravel()
    slopes = sparse.csr_array((slopes.ravel(), places), shape=(m, 2 * n))
    # How far each coordinate may go, and what that costs.
    reach = np.full(len(p), np.inf)
    np.minimum.at(reach, faces, np.median(lengths, 1)[:, None])
    reach = np.repeat(steps * np.maximum(reach[active], 10 * LEAST_EDGE), 2)
    price = np.repeat(PRICE**rank, 2)
    solution = scipy.optimize.linprog(
        np.concatenate([price, price, np.full(m, MISSING)]),  # forth, back, and what is missing
        sparse.hstack([-slopes, slopes, -sparse.eye_array(m)]).tocsr(),
        area / longest - wanted,
        bounds=np.stack([np.zeros(4 * n + m), np.r_[reach, reach, np.full(m, np.inf)]], 1),
    )
    x = solution.x[: 2 * n] - solution.x[2 * n : 4 * n]
    return np.einsum("nj,nji->ni", np.where(abs(x) < 1e-6, 0, x).reshape(n, 2), axes)


def across(p):
    """Two orthonormal directions across each point (n, 3) of a sphere around 0, (n, 2, 3)."""
    third = p / np.linalg.norm(p, axis=1)[:, None]
    first = np.cross(third, np.eye(3)[abs(third).argmin(1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(third, first)], 1)


ROUND = 1.001  # the largest radius by the smallest that a sphere may have, as Workbench wants it
RINGS = 4  # of the cortex that are distinguished, its rim the first


@dataclass(frozen=True, eq=False)
class Whole:
    """A whole closed surface by its faces (F, 3), outward where it was registered, and the cortex
    that was cut out of it: the `Disk` of its map, and the numbers `table` (V',) of its vertices in
    the whole."""

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
        """The vertices (W,) of the faces that are not cortex, sorted, and these faces numbered
        among them."""
        cortex = keys(self.table[self.disk.faces], self.count)
        rest = self.faces[~np.isin(keys(self.faces, self.count), cortex)]
        vertices, faces = np.unique(rest, return_inverse=True)
        return vertices, faces.reshape(-1, 3)

    def wall_disk(self, angles):
        """The wall as a `Disk`: its rim at `angles` (B,) complex, each inner vertex the mean of its
        neighbours."""
        vertices, faces = self.wall
        rim = np.searchsorted(vertices, self.rim)
        blocks = np.broadcast_to(3 * np.eye(3) - 1, (len(faces), 3, 3))
        laplace = assemble(faces, blocks, len(vertices))
        return Disk(Dirichlet(laplace, rim).solve(angles), faces)

    @cached_property
    def rings(self):
        """How far from the wall each vertex lies (V,): 0 on it, 1 on its rim, and so on up to RINGS
        + 1."""
        rings = np.full(self.count, RINGS + 1)
        rings[np.setdiff1d(self.wall[0], self.rim)] = 0
        rings[self.rim] = 1
        for ring in range(1, RINGS):
            touched = self.faces[(rings[self.faces] == ring).any(1)]
            rings[touched] = np.minimum(rings[touched], ring + 1)
        return rings


class RegisteredSphere(NamedTuple):
    """A whole hemisphere on a sphere: the `surface` (V vertices), the numbers `moved` (k,) of the
    vertices that untangling moved, and `rings` (V,), how far each lies from the wall: 0 on it, 1 on
    its rim, at most RINGS + 1."""

    surface: Surface
    moved: np.ndarray
    rings: np.ndarray


def registered_sphere(maps: dict, sphere: Surface) -> RegisteredSphere:
    """The whole moving hemisphere on the control's whole `sphere`, scaled to radius 100, in
    coordinates of float32.

    maps: the arrays of `read_registration`. The cortex goes by the disk map and the control's
    triangles. Both walls are mapped into one disk (Tutte), each vertex of the rim at the length
    along the control's rim where the cortex puts it, and go by the control's triangles there. Faces
    follow their vertices, outward; what is then flipped or too small is `untangled`. SurfaceError
    where the registration does not hold both surfaces whole, or the sphere is not the control's;
    UntanglingError.
    """
    moving = whole_of(maps, "moving")
    control = whole_of(maps, "control")
    unit = unit_sphere(sphere, control.faces)

    # The cortex by the disk map.
    places = control.disk.locate(drawn_in(moving.disk.z, control.disk.z[control.disk.loop]))
    points = np.empty((moving.count, 3))
    points[moving.table] = control.disk.interpolate(unit[control.table], places)

    # The wall by its rim, which runs clockwise as the wall sees it.
    angles = np.zeros(len(control.table), complex)
    angles[control.disk.loop] = np.exp(-1j * around(unit[control.rim]))
    there = control.wall_disk(angles[control.disk.loop])
    here = moving.wall_disk(control.disk.interpolate(angles, places)[moving.disk.loop])
    inner = ~np.isin(moving.wall[0], moving.rim)
    on_wall = there.interpolate(unit[control.wall[0]], there.locate(here.z[inner]))
    points[moving.wall[0][inner]] = on_wall
    points, moved = untangled(points, moving.faces, moving.rings)
    return RegisteredSphere(Surface(points, moving.faces), moved, moving.rings)


def drawn_in(z, rim):
    """Points z (V,) of the unit disk drawn into the polygon of `rim` (B,) on its circle: by half as
    much as they come nearer to the circle than two times the polygon's side stays away from it. One
    to one; what is farther in stays."""
    angles = np.sort(np.angle(rim))
    start = np.searchsorted(angles, np.angle(z), side="right") - 1
    half = np.diff(angles, append=angles[0] + 2 * np.pi)[start] / 2
    # How far the polygon's side is from 0, at z's angle.
    side = np.cos(half) / np.cos(np.angle(z * np.exp(-1j * (angles[start] + half))))
    size = abs(z)
    return z * np.minimum(1, (size + 2 * side - 1) / (2 * np.maximum(size, 0.5)))


def around(rim):
    """Angles (B,) from 0 of the points of a closed line (B, 3), by its length."""
    steps = np.cumsum(np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1))
    return 2 * np.pi * np.r_[0, steps[:-1]] / steps[-1]


def whole_of(maps, side):
    """The `Whole` of the side "moving" or "control" of a registration; SurfaceError where it does
    not hold one."""
    table = maps.get(f"table_{side}")
    faces = maps.get(f"whole_faces_{side}")
    require_whole(side, table, faces)
    table = table.astype(np.int64)
    faces = faces.astype(np.int64)
    disk = Disk(maps["disk_map" if side == "moving" else "disk_control"], maps[f"faces_{side}"])
    turned = not alike(table[disk.faces[0]], faces)  # it was mirrored
    return Whole(faces[:, ::-1] if turned else faces, disk, table)


def require_whole(side, table, faces):
    """SurfaceError unless the table (V,) of a registered side and its whole surface's faces (F, 3)
    are known, and that surface is closed and without handles."""
    if table is None or faces is None:
        option = "--cortex" if side == "moving" else "--control-cortex"
        raise SurfaceError(
            f"the whole {side} surface is not known, and a sphere needs its medial wall: run "
            f"`qclearn register` with the whole surface and {option}, or with the npz that "
            "`qclearn open` writes"
        )
    count = faces.max() + 1
    if len(faces) != 2 * count - 4:
        raise SurfaceError(
            f"the whole {side} surface is no sphere ({count} vertices, {len(faces)} faces): it "
            "has a boundary or handles; repair the topology where it was made (FreeSurfer: "
            "mris_fix_topology)"
        )


def alike(face, faces):
    """Whether one face (3,) runs the same way round among `faces` (F, 3)."""
    same = faces[(np.sort(faces, axis=1) == np.sort(face)).all(1)][0]
    return any(np.array_equal(np.roll(same, turn), face) for turn in range(3))


def keys(faces, count):
    """A number for each face (F, 3) of a mesh of `count` vertices, whatever the order of its
    corners."""
    low, middle, high = np.sort(faces, axis=1).T
    return (low * count + middle) * count + high


def unit_sphere(sphere, faces):
    """The vertices (V, 3) of a sphere that shall have these `faces` (F, 3), at radius 1;
    SurfaceError where it has others, is no sphere around 0, or looks inward."""
    count = int(faces.max()) + 1
    if (len(sphere.vertices), len(sphere.faces)) != (count, len(faces)):
        raise SurfaceError(
            f"{len(sphere.vertices)} vertices and {len(sphere.faces)} faces, where the control "
            f"has {count} and {len(faces)}: the sphere of another subject; give the control's own"
        )
    own = np.sort(keys(sphere.faces.astype(np.int64), count))
    if not np.array_equal(own, np.sort(keys(faces.astype(np.int64), count))):
        raise SurfaceError(
            "its faces are not the control's: the sphere of another subject; give the control's own"
        )
    radii = np.linalg.norm(sphere.vertices, axis=1)
    if not radii.max() < ROUND * radii.min():
        raise SurfaceError(no_sphere(sphere.vertices, radii))
    if sphere.volume < 0:
        raise SurfaceError(
            "the sphere looks inward: its faces are reversed, or it is mirrored, as one of the "
            "other hemisphere; give the control's own as FreeSurfer wrote it"
        )
    if not alike(sphere.faces[0], faces):
        raise SurfaceError(
            "its faces run the other way round than the control's: it is of the other hemisphere, "
            "or mirrored; give the control's own"
        )
    return sphere.vertices / radii[:, None]


def no_sphere(vertices, radii):
    """Why vertices (V, 3) at distances `radii` (V,) from 0 are no sphere around it, a message."""
    equations = np.column_stack([2 * vertices, np.ones(len(vertices))])
    centre = np.linalg.lstsq(equations, radii**2)[0][:3]
    off = np.linalg.norm(vertices - centre, axis=1)
    if off.max() <= ROUND * off.min():
        place = ", ".join(f"{x:.1f}" for x in centre.round(1) + 0.0)  # no -0.0
        return (
            f"a sphere around ({place}), where Workbench and FreeSurfer need one around 0; give "
            "it as FreeSurfer wrote it (mris_convert --to-scanner moves it)"
        )
    return (
        f"not a sphere: its vertices lie {radii.min():.4g} to {radii.max():.4g} from 0; give "
        "lh.sphere or lh.sphere.reg of the control (lh.inflated is none)"
    )
