"""Synthetic cortical hemispheres with named sulci and a known dense correspondence."""

from dataclasses import dataclass

import numpy as np

from qclearn.interrupts import signals_wait
from qclearn.surfaces.surface import Surface

from .fundus import trace, trim
from .generations import GENERATION, GENERATIONS
from .individual import Individual, smooth_field
from .pattern import pattern
from .template import LONGEST
from .untangle import untangle

HEMISPHERES = ("left", "right")
FEWEST, MOST = 1_000, 200_000


class CortexError(ValueError):
    """A synthetic hemisphere that cannot be made, read or matched: says what is possible."""


@dataclass(frozen=True)
class Mechanics:
    """The growing shell. Lengths in half the hemisphere, stiffness in edge springs."""

    growth: float = 1.81  # final stretch of the rest lengths
    modulation: float = 0.03  # its smooth relative variation
    bending: float = 1.2  # umbrella bi-Laplacian
    foundation: float = 0.0125  # spring to the unfolded surface ...
    saturation: float = 0.18  # ... whose force stays constant beyond this displacement
    limit: float = 0.35  # stiffness of the two limits
    outer: float = 0.005  # limit outside the hull (skull)
    depth: float = 0.26  # floor inside the hull
    touch: float = 1.3  # contact distance in grown edge lengths
    stiffness: float = 3.0  # of contact
    keep: float = 0.05  # share of the early pull on furrows that stays
    noise: float = 0.01  # random initial relief
    steps: int = 2000  # more above 10,000 vertices, like n^(1/2)
    time_step: float = 0.2
    damping: float = 0.25
    refresh: int = 10  # steps between contact searches
    settle: float = 1.8  # factor that the bending reaches after growth, which rounds the creases


@dataclass(frozen=True)
class Cortex:
    """A synthetic hemisphere in mm with its curves, and its vertices' template points (V, 3).

    The template's frame is lateral, anterior, superior for both sides, so homologous points of left
    and right agree. generation: of the generator's constants. interrupted, branched: the names of
    the sulci that were drawn with a gap (a gyrus may bridge them) or with side branches; the growth
    decides how much of either shows.
    """

    surface: Surface
    template: np.ndarray
    seed: int
    hemisphere: str
    generation: int
    interrupted: tuple[str, ...] = ()
    branched: tuple[str, ...] = ()

    @property
    def curves(self):
        """Named fundus paths, dict name -> (k,) vertices: the surface's own."""
        return self.surface.curves


def require_generation(generation):
    """CortexError unless this version makes the generation."""
    if generation not in GENERATIONS:
        known = " and ".join(map(str, GENERATIONS))
        raise CortexError(f"the generation is {generation!r}; this version makes {known}.")


def require_one_generation(subjects):
    """CortexError if the subjects, a list of Cortex, are of several generations."""
    generations = sorted({subject.generation for subject in subjects})
    if len(generations) > 1:
        raise CortexError(
            f"the subjects are of the generations {', '.join(map(str, generations))}, whose folds follow "
            "other rules; make all with one version of the generator."
        )


def _check(seed, n_vertices, hemisphere="left"):
    if not isinstance(seed, (int, np.integer)) or isinstance(seed, bool) or not 0 <= seed < 2**63:
        raise CortexError(f"the seed is {seed!r}; give a whole number from 0, below 2^63.")
    if not isinstance(n_vertices, (int, np.integer)) or not FEWEST <= n_vertices <= MOST:
        raise CortexError(
            f"n_vertices is {n_vertices!r}; give a whole number from {FEWEST:,} to {MOST:,}."
        )
    if hemisphere not in HEMISPHERES:
        raise CortexError(
            f"the hemisphere is {hemisphere!r}; choose one of {', '.join(HEMISPHERES)}."
        )


def _normals(x, faces):
    return np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])


def _area(x, faces):
    return np.linalg.norm(_normals(x, faces), axis=1).sum() / 2


def vertex_normals(x, faces):
    """Unit normals (V, 3), area weighted."""
    n = _normals(x, faces)
    total = np.stack(
        [np.bincount(faces.ravel(), np.repeat(n[:, k], 3), len(x)) for k in range(3)], axis=1
    )
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def make_cortex(
    seed,
    n_vertices=10_000,
    hemisphere="left",
    mechanics=Mechanics(),
    clock=None,
    generation=GENERATION,
):
    """A folded hemisphere without its medial wall: a disk of n_vertices, outward oriented, in
    millimetres (x right, y anterior, z superior), with the fundi of eight named sulci and every
    vertex' point on the template.

    The seed (a whole number from 0) decides everything: the same seed, size, side and generation
    give the same hemisphere, and both sides of a seed resemble each other. Folds have the width of
    real ones from 8,000 vertices; coarser meshes fold more coarsely. Folds form 1 to 3 mm beside
    what corresponds on the template. Takes time like n^1.5, 10 s at 10,000; `clock`, int64 (2,), is
    set to the steps of growth done and in all, for a progress bar in another thread. CortexError
    for a seed, size, side or generation that is not possible.
    """
    _check(seed, n_vertices, hemisphere)
    require_generation(generation)
    person = Individual(seed, hemisphere, GENERATIONS[generation])
    surface, template = grown(person, n_vertices, mechanics, clock)
    traits = tuple(person.interrupted), tuple(person.branched)
    return Cortex(surface, template, seed, hemisphere, generation, *traits)


def unfolded(cortex, template):
    """The smooth surface (k, 3) that a subject grew from, at template points (k, 3)."""
    require_generation(cortex.generation)
    person = Individual(cortex.seed, cortex.hemisphere, GENERATIONS[cortex.generation])
    return person.position(person.deform(template))


def growth_frames(seed, n_vertices=3_000, frames=20):
    """The left hemisphere of `make_cortex` while it grows: (positions (K, V, 3) in mm, faces (F,
    3), factors (K,) by which the rest lengths of the edges have grown until then). The last
    positions are those of its surface.

    Edges along furrows grow less than the factors say, others vary around them by a few percent.
    All positions have the scale of the last, so that areas can be compared. CortexError as for
    `make_cortex`.
    """
    with signals_wait():
        from .growth import GROWN  # where something grows: numba takes a second to import

    _check(seed, n_vertices)
    m, film = Mechanics(), np.empty((frames - 1, n_vertices, 3))
    surface, _ = grown(Individual(seed, "left"), n_vertices, m, film=film)
    progress = np.minimum(1, np.arange(frames) / (GROWN * (frames - 1)))
    positions = np.concatenate([film, surface.vertices[None]])
    return positions, surface.faces, 1 + (m.growth - 1) * progress


def grown(person, n_vertices, mechanics=Mechanics(), clock=None, film=None):
    """The folded surface of an `Individual` with its curves, and its template points (V, 3).

    film (K, V, 3): becomes positions of its growth, as in `grow`, to the scale of the surface."""
    with signals_wait():
        from .growth import Sheet, depth_below, neighbour_table
    from .tessellation import even_points, triangulate

    directions, rim = even_points(person.position, n_vertices, person.rng)
    rest, template = person.position(directions), person.template(directions)
    faces = triangulate(rim, rest, template)
    sheet = Sheet(rest, faces, *neighbour_table(faces, n_vertices))
    held = np.arange(n_vertices) < rim
    clock = np.zeros(2, dtype=np.int64) if clock is None else clock
    film = np.empty((0, n_vertices, 3)) if film is None else film
    x, hull = _fold(person, directions, template, held, sheet, mechanics, (clock, film))
    x = untangle(x, faces, sheet.start, sheet.index, held)
    # fundus paths of the named sulci
    depth, normal = depth_below(x, *hull), vertex_normals(x, faces)
    length, curves = np.sqrt(_area(x, faces)), {}
    for name, course in person.courses.items():
        path = trace(x, sheet, normal, depth, person.position(course), person.guidance)
        curves[name] = trim(x, path, depth, LONGEST.get(name, np.inf) * length)
    left = person.hemisphere == "left"
    scale = np.sqrt(person.area / _area(x, faces)) * np.array([-1 if left else 1, 1, 1])
    film *= scale
    return Surface(x * scale, faces[:, ::-1] if left else faces, curves), template


def _fold(person, directions, template, held, sheet, mechanics, record):
    """Folded positions (V, 3), in units of half the hemisphere, and the distance field of the hull.

    record: the clock and the film that `grow` keeps."""
    from .growth import grow, hull_distance

    m, guidance, count = mechanics, person.guidance, len(sheet.rest)
    # With n vertices an edge is as long as n^-1/2: these factors keep modulus and wavelength.
    ratio = count / 10_000
    normal, furrows = vertex_normals(sheet.rest, sheet.faces), person.furrows(sheet.rest)
    rest_length = sheet.lengths(sheet.rest)
    growth = _growth(person, directions, sheet, furrows, m)
    relief = np.where(held, 0, m.noise * smooth_field(person.rng, directions, 0.1, 600))
    hold = guidance.hold * furrows.hold
    if guidance.pattern:
        hold = hold + guidance.pattern * person.presence(directions) * pattern(template)
    settings = (
        round(m.steps * max(1, ratio) ** 0.5), m.time_step, m.damping, m.bending * ratio, m.saturation, m.outer,
        m.depth, m.touch * rest_length.mean(), m.stiffness, m.refresh, m.settle, m.limit, m.keep,
    )  # fmt: skip
    hull = hull_distance(person.hull)
    x = grow(
        sheet.rest + relief[:, None] * normal, sheet.rest, normal, sheet.start, sheet.index, rest_length, held, growth,
        np.full(count, m.foundation / ratio), guidance.pull / ratio * furrows.pull, hold / ratio, *hull,
        np.array(settings, dtype=float), record,
    )  # fmt: skip
    return x, hull


def _growth(person, directions, sheet, furrows, mechanics):
    """Final stretch (2E,) of the edges, less along furrows: real fundi are nearly straight, it is
    their banks that buckle."""
    rest, owner, index = sheet.rest, sheet.owner, sheet.index
    edge = (rest[index] - rest[owner]) / sheet.lengths(rest)[:, None]
    parallel = sum(
        0.5 * np.einsum("ij,ij->i", edge, furrows.along[ends]) ** 2 * furrows.band[ends]
        for ends in (owner, index)
    )
    growth = 1 + mechanics.modulation * smooth_field(person.rng, directions, 0.5, 80)
    growth = mechanics.growth * 0.5 * (growth[owner] + growth[index])
    return 1 + (growth - 1) * (1 - person.guidance.anisotropy * parallel)
