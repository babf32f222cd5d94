"""One or two curves, or none: the folds tell a left from a right, and ends that lie elsewhere.
fsaverage5 has both."""

from dataclasses import replace

import meshes
import numpy as np
import pytest

from qclearn.io.fsaverage import demo_landmarks, fsaverage5
from qclearn.plane.disk import Disk
from qclearn.plane.mobius import mobius
from qclearn.registration.curves import check_curves
from qclearn.registration.diagnose import (
    LIMITS,
    diagnose_landmarks,
    laid_by_folds,
    rotation_contrast,
    with_folds,
)
from qclearn.registration.features import mirrored_gain
from qclearn.registration.pair import SurfacePair, align_disks
from qclearn.surfaces.conformal import parameterize
from qclearn.surfaces.surface import Surface, mirror

SULCI = demo_landmarks()["curves"]


@pytest.fixture(scope="module")
def sides():
    """fsaverage5's mirrored right hemisphere and its left one, each on its disk, with their folds."""
    return with_folds(
        SurfacePair(
            parameterize(mirror(fsaverage5("right"))), parameterize(fsaverage5("left")), [], []
        )
    )


@pytest.fixture(scope="module")
def aligned(sides):
    return align_disks(sides)


def other_hand(side):
    """A `ParameterizedSurface` and its features, which know nothing of hands, seen in a mirror."""
    surface = mirror(side.surface)
    return replace(side, surface=surface, disk=Disk(side.disk.z.conj(), surface.faces))


def said(sides, curves):
    """The words on curves of two sides, laid upon each other by them."""
    return diagnose_landmarks(
        align_disks(
            replace(sides, curves=check_curves(curves, sides.moving.surface, sides.control.surface))
        )
    )


def backwards(entry):
    return entry | {"moving": entry["moving"][::-1]}


def test_without_landmarks_the_right_hand_is_not_suspect(aligned):
    assert diagnose_landmarks(aligned) == []
    assert mirrored_gain(aligned.moving, aligned.control) < -0.3


def test_without_landmarks_the_wrong_hand_is_recognised(sides):
    wrong = align_disks(replace(sides, moving=other_hand(sides.moving)))
    (reason,) = diagnose_landmarks(wrong)
    assert reason.startswith("mirror: the folds fit") and "--mirror" in reason
    assert mirrored_gain(wrong.moving, wrong.control) > 0.3


def test_a_curve_does_not_hide_the_wrong_hand(sides):
    (reason,) = said(replace(sides, moving=other_hand(sides.moving)), SULCI[:1])
    assert reason.startswith("mirror: the folds fit")


@pytest.mark.parametrize("subset", [slice(0, 1), slice(7, 9)], ids=str)
def test_one_or_two_good_curves_are_not_suspect(sides, subset):
    assert said(sides, SULCI[subset]) == []


@pytest.mark.parametrize("others", [[], [SULCI[5]]], ids=["alone", "beside another"])
def test_a_reversed_curve_is_recognised_and_named(sides, others):
    (reason,) = said(sides, [backwards(SULCI[0]), *others])
    assert reason.startswith(f"reversed: {SULCI[0]['name']!r} fits")


def test_one_curve_in_numbers_of_the_whole_surface_is_recognised(sides):
    table = sides.moving.surface.original_vertices
    (reason,) = said(sides, [SULCI[0] | {"moving": table[SULCI[0]["moving"]].tolist()}])
    assert reason.startswith("numbering: the moving vertices")


def test_what_the_folds_say_does_not_hang_on_where_the_landmarks_laid_the_disk(sides):
    entries = check_curves(SULCI[:1], sides.moving.surface, sides.control.surface)
    disk = sides.moving.disk
    aside = replace(sides.moving, disk=disk.at(mobius(disk.z, 0.9 - 0.3j, 2.0)))
    places = [
        laid_by_folds(replace(sides, moving=own, curves=entries)).moving.disk.z
        for own in (sides.moving, aside)
    ]
    assert abs(places[0] - places[1]).max() < 1e-3


# Where the folds say nothing


@pytest.fixture
def round_bowls():
    """Two bowls of revolution with one spoke, which runs from the rim inwards on one side: what is
    right?"""
    path = np.arange(1, 1 + 24 * 6, 24)
    moving, control = (
        parameterize(meshes.bowl(height, curves={"east": path})) for height in (0.6, 0.9)
    )
    curves = [{"name": "east", "moving": path[::-1], "control": path}]
    return SurfacePair(moving, control, check_curves(curves, moving.surface, control.surface), [])


def test_surfaces_of_revolution_judge_no_curve(round_bowls):
    laid = laid_by_folds(align_disks(round_bowls))
    assert rotation_contrast(laid) < LIMITS["rotation_contrast"]
    assert (
        abs(mirrored_gain(laid.moving, laid.control)) < LIMITS["hand"]
        and diagnose_landmarks(align_disks(round_bowls)) == []
    )


def test_flat_surfaces_judge_no_curve(round_bowls):
    def flat(side):
        surface = Surface(side.surface.vertices * [1.0, 1.0, 0.0], side.surface.faces)
        return replace(side, surface=surface)

    plain = replace(round_bowls, moving=flat(round_bowls.moving), control=flat(round_bowls.control))
    assert laid_by_folds(plain) is None and diagnose_landmarks(plain) == []
