"""What is said of a map, in reports and tables: its errors before and after the fit, its
coefficient, its distortion, held-out curves, the paper's losses."""

from dataclasses import asdict
from importlib.metadata import version

import numpy as np

from ..plane.linear import around_vertices, degenerate_faces, face_areas
from ..plane.mobius import mobius
from ..surfaces.units import other_units, relative_units, size_of
from .curves import POINTS_PER_CURVE, SIDES, curve_distance, curves_in_space, sample_curve
from .diagnose import FEWEST, align_by_folds, astray, differing_walls, disagreeing, reasons, worse

# Errors of a landmark or a curve, before the fit (best Möbius map) and after it, in the disk and in
# mm.
ERRORS = ("landmark_error_before", "landmark_error", "landmark_error_mm")
STOPPED = (
    "the landmarks or the surfaces are wrong (see suspect), so nothing was fitted: this is the "
    "Möbius map that aligns the ends of the curves, or the folds; features, held-out curves and the "
    "radius were not computed; correct them, or fit them as they are by accept_suspect=True, "
    "--accept-suspect"
)
SMALLEST_RATIO = 1e-6  # of a face's area to its share, where it is measured
SMALLEST_IN_FILES = 1e-9  # of areas that coordinates of float32 bear out


def report_of(pair, weights, fit, points, wrong, stopped):
    """The report of a registration, a dict for JSON, without method and seconds.

    pair: with its landmarks sampled; its `mobius_before` is the `_before` of everything; points
    (V, 3): the moving vertices on the control; wrong: messages of `diagnose_landmarks`; stopped:
    whether nothing was fitted because of them.
    """
    moving = pair.moving.surface
    features = pair.features
    before = mobius(pair.moving.disk.z, *pair.mobius_before)

    # Landmarks: the mean of each error over the curves that have it, null without any.
    rows = error_rows(pair, fit.f)
    means = dict.fromkeys(ERRORS)
    for key in (*ERRORS, "landmark_error_true"):
        values = [row[key] for row in rows if key in row]
        means |= {key: float(np.mean(values))} if values else {}

    # Features: their correlation r.
    walls = [*differing_walls(moving, pair.control.surface)]
    r, disagreements = {}, []
    if features:
        rs = (features.correlation(f).tolist() for f in (before, fit.f))
        r = dict(zip(features.names, map(list, zip(*rs))))
        # Curves too few to determine `mobius_before` make way for the features' best Möbius map;
        # enough of them know the place in space.
        few = len(pair.curves) < FEWEST
        aligned = align_by_folds(pair).moving.disk.z if pair.curves and few else before
        nearer = astray(pair, fit.f, walls) if few else ()
        disagreements = [*disagreeing(features, aligned, fit.f, walls)] or [*nearer]

    # The surface: how much of it is stretched.
    shares = moving.face_areas / moving.area
    distortion = {
        name: {str(share): quantile(values, shares, share / 100) for share in (50, 95, 100)}
        for name, values in log2_stretches(moving, points).items()
    }

    # What looks wrong, and what was done besides.
    held_out = held_out_distances(pair, pair.held_lines, before, fit.f)
    repaired = [f"{side}: {word}" for side in SIDES for word in getattr(pair, side).messages]
    messages = [*walls, *repaired, *pair.messages]
    suspect = [*wrong, *other_units(moving=moving, control=pair.control.surface)]
    if not stopped:
        found = reasons(moving, rows, fit, distortion["log2_area"]["95"], bool(features))
        doubts = [*found, *disagreements, *worse(held_out, bool(features))]
        suspect += [*walls, *doubts] if doubts else []  # the likely cause of all of them first
    elif not pair.curves:
        suspect = [*walls, *suspect]  # folds of surfaces cut so differently may mistake the hand
    return {
        **means,
        **coefficient_statistics(fit.mu),
        **log2_distortions(moving, points),
        "distortion": distortion,
        "flipped": len(fit.flipped),
        "bijective": fit.bijective,
        "degenerate": len(degenerate_faces(points, moving.faces)),
        "fallbacks": [*messages, *fit.fallbacks],
        **asdict(weights),
        "features": dict(zip(features.names, features.feature_weights.tolist()))
        if features
        else {},
        "r": r,
        "start": fit.start_message if features else "",
        "mobius": {"a": [fit.mobius[0].real, fit.mobius[0].imag], "theta": fit.mobius[1]},
        "curves": rows,
        "held_out_mm": held_out,
        "suspect": suspect,
        "stopped": STOPPED if stopped else None,
        "units": relative_units(pair.control.surface),
        "version": version("qclearn"),
    }


def error_rows(pair, f):
    """Per curve, dict: its name and the means of its landmarks' ERRORS, for the map f (V,) of
    a pair with landmarks sampled; for a detected curve also `landmark_error_true`, between the true
    curves, where the surfaces carry them."""
    if not pair.curves:
        return []
    moving, control = pair.moving, pair.control
    here, there = pair.samples
    mapped = here @ f
    q = there @ control.disk.z
    before = abs(mobius(here @ moving.disk.z, *pair.mobius_before) - q)
    off_mm = np.linalg.norm(control.lift(mapped) - there @ control.surface.vertices, axis=1)
    off_mm /= size_of(control.surface).mm
    by_curve = np.reshape([before, abs(mapped - q), off_mm], (3, len(pair.curves), -1)).mean(2)
    rows = []
    for curve, errors in zip(pair.curves, by_curve.T.tolist()):
        row = {"name": curve.name, **dict(zip(ERRORS, errors))}
        rows.append(row)
        # The true path of a side is the one that is given, or that the surface carries between the
        # given ends.
        true = []
        for side in SIDES:
            path = curve.path(side)
            known = getattr(pair, side).surface.curves.get(curve.name)
            if not curve.detect[side]:
                true.append(path)
            elif known is not None and sorted(known[[0, -1]]) == sorted(path):
                true.append(known if known[0] == path[0] else known[::-1])
        if any(curve.detect.values()) and len(true) == len(SIDES):
            after = sample_curve(moving.surface, true[0], POINTS_PER_CURVE) @ f
            target = sample_curve(control.surface, true[1], POINTS_PER_CURVE) @ control.disk.z
            row["landmark_error_true"] = float(abs(after - target).mean())
    return rows


def held_out_distances(pair, lines, *maps):
    """Held-out curve -> `curve_distance`, mm, between its image by each of the maps (V,) and itself
    on the control. lines: name -> (moving, control) line in the disks of the pair, as
    `SurfacePair.held_lines`."""
    if not lines:
        return {}
    moving, control = zip(*lines.values())
    stops = np.cumsum([len(line) for line in moving])[:-1]
    samples = pair.moving.disk.interpolation(np.concatenate(moving))
    targets = curves_in_space(pair.control, control)
    images = [curves_in_space(pair.control, np.split(samples @ f, stops)) for f in maps]
    mm = size_of(pair.control.surface).mm
    return {
        name: [float(curve_distance(curve, target) / mm) for curve in curves]
        for name, target, curves in zip(lines, targets, zip(*images))
    }


def coefficient_statistics(mu):
    """Mean, standard deviation and maximum of |mu| over the faces of the moving mesh."""
    size = abs(mu)
    return {
        "mean_abs_mu": float(size.mean()),
        "sd_abs_mu": float(size.std()),
        "max_abs_mu": float(size.max()),
    }


def measured_losses(problem, weights, mu, mapped):
    """The paper's loss and its terms, L_mu, L_grad_mu, L_Landmark, L_CP, of a map's measured mu
    (F,) and its landmarks `mapped` (M,).

    `L_mu = (1/pi) sum |T| |mu_T|^2`; for `L_grad_mu = (1/pi) int |grad mu|^2` mu is made piecewise
    linear by averages over the faces around each vertex, by area. Source: paper, eqs. muloss,
    musmooth, lmloss, RegLoss.
    """
    disk = problem.disk
    nodal = disk.to_vertices @ mu
    mean_square = disk.areas @ abs(mu) ** 2 / np.pi
    mean_gradient = (nodal.conj() @ (disk.laplace @ nodal)).real / np.pi
    return weights.losses(mean_square, mean_gradient, abs(mapped - problem.target))


def log2_distortions(surface, points):
    """How much the registration stretches, moving surface -> points (V, 3): [mean, 95 %] over the
    surface's area.

    `log2_area`: |log2 J|, J the ratio of areas, at least `SMALLEST_RATIO`, total areas made equal;
    `log2_shape`: log2 of the ratio of the principal stretches, `(1 + |mu|) / (1 - |mu|)`.
    """
    weights = surface.face_areas / surface.area
    return {
        name: [float(weights @ values), quantile(values, weights)]
        for name, values in log2_stretches(surface, points).items()
    }


def log2_stretches(surface, points):
    """`log2_area` and `log2_shape` of each face (F,), as of `log2_distortions`."""
    area, shape = stretches(surface.vertices, surface.faces, points)
    area = np.maximum(area / (surface.face_areas @ area / surface.area), SMALLEST_RATIO)
    return {"log2_area": abs(np.log2(area)), "log2_shape": np.log2(shape)}


def distortion_maps(vertices, faces, images):
    """Areal and shape distortion at the vertices (V, 3) that go to `images` (V, 3), (V,) each, as
    Workbench has them.

    Areal: log2 J, J the ratio of the areas around a vertex, at least `SMALLEST_IN_FILES`
    (`wb_command -surface-distortion`); shape: log2 of the mean, over the faces around a vertex, of
    the ratio of the principal stretches (its `-local-affine-method -log2`). Total areas are left as
    they are.
    """
    area, shape = stretches(vertices, faces, images)
    before = face_areas(vertices, faces)
    ratio = around_vertices(before * area, faces) / around_vertices(before, faces)
    mean_shape = around_vertices(shape, faces) / np.bincount(faces.ravel())
    return np.log2(np.maximum(ratio, SMALLEST_IN_FILES)), np.log2(mean_shape)


def area_and_shape(surface, points):
    """log2 J and log2 R (V,) at the vertices, for surface -> points (V, 3) of equal total area.

    As `wb_command -surface-distortion -local-affine-method -log2`.
    """
    share = np.sqrt(surface.area / face_areas(points, surface.faces).sum())
    return distortion_maps(surface.vertices, surface.faces, share * points)


def stretches(vertices, faces, images):
    """Ratios of the areas, and of the principal stretches, `(1 + |mu|) / (1 - |mu|)`, of a map of
    faces, (F,) each."""
    tiny = np.finfo(float).tiny
    flat = []
    for corners in (vertices[faces], images[faces]):
        # Two edges of each face, from its first corner, in its plane: complex (2, F).
        first = corners[:, 1] - corners[:, 0]
        second = corners[:, 2] - corners[:, 0]
        length = np.linalg.norm(first, axis=1)
        along = first / np.maximum(length, tiny)[:, None]
        x = (second * along).sum(1)
        y = np.linalg.norm(second - x[:, None] * along, axis=1)
        flat.append(np.stack([length + 0j, x + 1j * y]))
    p, q = flat
    # On each face the map is w -> a w + b conj(w).
    double_area = p[0] * p[1].conj() - p[1] * p[0].conj()
    a = (q[0] * p[1].conj() - q[1] * p[0].conj()) / double_area
    b = (q[1] * p[0] - q[0] * p[1]) / double_area
    mu = np.minimum(abs(b) / np.maximum(abs(a), tiny), 1 - SMALLEST_RATIO)
    return abs(a) ** 2 - abs(b) ** 2, (1 + mu) / (1 - mu)


def quantile(values, shares, share=0.95):
    """The value of (F,) below which `share` of the area lies; shares (F,): of the area."""
    order = np.argsort(values)
    rank = np.searchsorted(np.cumsum(shares[order]), share)
    return float(values[order[min(rank, len(order) - 1)]])  # rounding may leave the sum below 1
