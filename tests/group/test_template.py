"""Templates: found again from subjects that known maps have moved, whatever their order, and
resumed where stopped."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from distributed import Client, LocalCluster

import qclearn as qc
from exactmaps import twist
from qclearn.group import subject as of
from qclearn.group.members import members_of
from qclearn.group.rounds import Folder, Group
from qclearn.group.subject import Fitted, Mean, Shared, mean_of, onto
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.registration import features
from qclearn.registration.features import FeatureError
from qclearn.registration.problem import Weights
from qclearn.surfaces.surface import Surface, SurfaceError

TURNS = (-0.5, 0.1, 0.4)  # of the twists by which the subjects differ; their sum is 0


def bowl(rings, height):
    z, faces = polar_disk(rings, 3 * rings)
    rise = height * (1 - abs(z) ** 2)
    return Surface(np.stack([z.real, z.imag, rise], axis=1), faces)


def folds(w):
    """Two maps of the disk that no symmetry takes to themselves."""
    return (np.cos(8 * w.real + 2 * w.imag) + w.real, np.sin(7 * w.imag + 4 * w.real**2) - 0.5 * w.imag)


def place(surface):
    """The places in the plane above which the vertices of a bowl lie."""
    return surface.vertices[:, 0] + 1j * surface.vertices[:, 1]


SURFACES = {f"bowl {k}": bowl(12 + k, 0.5 + 0.1 * k) for k in range(3)}
MAPS = [folds(twist(turn)(place(surface))) for turn, surface in zip(TURNS, SURFACES.values())]
FEATURES = [(name, [maps[k] for maps in MAPS]) for k, name in enumerate(("sulc", "myelin"))]


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Where a Möbius map begins is known here: few starts will do."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"ROUNDS": 8}.items():
            patch.setattr(features, name, value)
        patch.setattr("qclearn.group.template.commit", lambda: "c0ffee")  # somebody may work on the checkout
        yield


def of_bowls(number=2, **options):
    return qc.template(SURFACES, FEATURES, **{"rounds": number, "delta": 1.0, "workers": 1} | options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rounds")


@pytest.fixture(scope="module")
def found(folder):
    return of_bowls(folder=folder)


def spread(template, disks):
    """How far apart on the common disk the subjects' points are, on average, that disk maps take to
    the vertices."""
    common = []
    for turn, (name, surface) in zip(TURNS, SURFACES.items()):
        disk = Disk(disks[name], surface.faces)
        common.append(twist(turn)(disk.interpolate(place(surface), disk.locate(template.disk))))
    return np.std(common, axis=0).mean()


def test_the_maps_bring_together_what_belongs_together(found):
    before, after = (spread(found, disks) for disks in (found.disks, found.disk_maps))
    assert after < before / 3
    first, *_, last = found.report["rounds"]
    areas = SURFACES["bowl 1"].vertex_areas
    for name, maps in zip(("sulc", "myelin"), MAPS[1]):
        most = np.cov(maps, aweights=areas, ddof=0)  # of one subject's map, where others blur nothing
        assert first["variance"][name] < last["variance"][name] < 1.02 * most
        assert last["r"][name] > 0.98


def test_the_average_of_the_inverse_maps_is_the_identity(found):
    """Measured here from the maps themselves; along the rim they are laid on the circle."""
    inverses = [
        (disk := Disk(found.disk_maps[name], surface.faces)).interpolate(found.disks[name], disk.locate(found.disk))
        for name, surface in SURFACES.items()
    ]
    inner = abs(found.disk) < 0.95
    off = abs(np.mean(inverses, axis=0) - found.disk)[inner]
    apart = np.std(inverses, axis=0)[inner]
    assert off.mean() < 0.02 * apart.mean()


def test_every_map_and_the_mean_are_certified(found):
    assert set(found.disk_maps) == set(SURFACES) and found.left_out == {}
    for name, surface in SURFACES.items():
        assert qc.check_bijective(found.disks[name], surface.faces, found.disk_maps[name]).bijective
    assert qc.check_embedding(found.surface.faces, found.disk).bijective
    assert abs(abs(found.disk[found.surface.boundary]) - 1).max() < 1e-12
    assert found.surface.volume > 0


def test_it_stands_still_after_a_few_rounds(found, folder):
    assert found.report["settled"] and not of_bowls(1, folder=folder).report["settled"]
    moved = [row["moved_mm"] for row in found.report["rounds"]]
    assert moved[0] == 0 and moved[2] < 0.3 * moved[1]


def test_the_order_of_the_subjects_makes_no_difference(folder):
    names = list(SURFACES)[::-1]
    features = [(name, maps[::-1]) for name, maps in FEATURES]
    other = qc.template({name: SURFACES[name] for name in names}, features, rounds=1, delta=1.0, workers=1)
    same = of_bowls(1, folder=folder)
    np.testing.assert_array_equal(other.surface.vertices, same.surface.vertices)
    for name in names:
        np.testing.assert_array_equal(other.disk_maps[name], same.disk_maps[name])
    assert other.report == same.report


def test_a_run_that_was_stopped_goes_on(found, folder, monkeypatch):
    lost, damaged = sorted(folder.glob("round-2-*.npz"))[:2]
    lost.unlink()
    damaged.write_bytes(damaged.read_bytes()[:-100])
    asked, whole = [], of.fitted
    monkeypatch.setattr(of, "fitted", lambda *given: asked.append(given) or whole(*given))
    again = of_bowls(folder=folder)
    assert len(asked) == 2 and again.report == found.report
    np.testing.assert_array_equal(again.surface.vertices, found.surface.vertices)
    assert [path.name for path in folder.iterdir() if not path.name.startswith("round-")] == ["settings.json"]


ONE = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": "127.0.0.1:0"}


def test_a_value_that_is_sent_again_is_not_lost():
    """One mean goes to the workers in a registration and again in the average behind it."""
    with LocalCluster(**ONE) as cluster, Client(cluster) as client:
        group = Group(client, [], [], None, None)
        for _ in range(20):
            for _ in range(2):
                there = group.sent(MAPS[0][0])
                assert group.submit(len, there).result() == len(MAPS[0][0])
                del there


def test_a_scheduler_gives_what_this_process_gives(found, folder):
    with LocalCluster(**ONE) as cluster:
        other = of_bowls(folder=folder, scheduler=cluster.scheduler_address)
    np.testing.assert_array_equal(other.surface.vertices, found.surface.vertices)
    assert other.report == found.report


def test_a_suspect_subject_is_named_and_takes_no_part(found, folder, tmp_path):
    """As if the first round had found it so."""
    shutil.copytree(folder, tmp_path / "rounds")
    rounds = Folder(tmp_path / "rounds", json.loads((folder / "settings.json").read_text()))
    keys = {member.name: member.key for member in members_of(SURFACES, FEATURES)[0]}
    rounds.write(1, keys["bowl 2"], Fitted(found.disk_maps["bowl 2"], ["features: hardly agree"]))
    two = of_bowls(1, folder=tmp_path / "rounds")
    assert two.left_out == two.report["left_out"] == {"bowl 2": ["features: hardly agree"]}
    assert set(two.disk_maps) == {"bowl 0", "bowl 1"}
    assert np.linalg.norm(two.surface.vertices - of_bowls(1, folder=folder).surface.vertices, axis=1).mean() > 1e-3
    rounds.write(1, keys["bowl 1"], Fitted(None, ["folds: everywhere"]))
    with pytest.raises(qc.TemplateError, match="fewer than two .* .bowl 1: folds: everywhere; bowl 2: features:"):
        of_bowls(1, folder=tmp_path / "rounds")


def test_a_map_that_folds_or_strays_is_suspect(monkeypatch):
    surface, names = SURFACES["bowl 0"], ["sulc"]
    one = of.prepared(surface, names, {"sulc": MAPS[0][0]})
    other = of.alone(of.prepared(surface, names, {"sulc": np.random.default_rng(0).normal(size=len(MAPS[0][0]))}))
    (reason,) = of.fitted(one, other, Weights(delta=0.3)).reasons
    assert reason.startswith("features: 'sulc' of the two sides hardly agrees")

    def folded(*_):
        raise qc.BijectivityError("no bijective map")

    monkeypatch.setattr(of, "fit_with_fallbacks", folded)
    found = of.fitted(one, other, Weights(delta=0.3))
    assert found.f is None and found.reasons == ["folds: no bijective map"]


# Averages


def test_a_mean_of_shapes_is_turned_and_shifted_onto_one_place():
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(20, 3)), rng.uniform(1, 2, 20)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    np.testing.assert_allclose(onto(points @ turn + [1, 2, 3], points, weights), points, atol=1e-12)
    mirrored = points * [-1, 1, 1]
    assert np.linalg.norm(onto(mirrored, points, weights) - points) > 1  # not by a reflection


def test_the_mean_is_the_sum_over_the_count():
    shares = [
        Shared(np.full((4, 3), k), np.full((4, 1), k), {4.0: np.full((4, 1), k)}, np.full(4, k)) for k in (1.0, 4.0)
    ]
    flat = Mean(np.zeros((4, 3)), np.zeros((4, 1)), {}, np.ones(4), Disk(np.zeros(4), [[0, 1, 2]]))
    mean = mean_of(iter(shares), 2, flat)
    assert (mean.points == 2.5).all() and (mean.values == 2.5).all() and (mean.areas == 2.5).all()
    assert (mean.levels[4.0] == 2.5).all()


# What is refused


def changed(**traits):
    return [SimpleNamespace(surface=surface, **{name: values[k] for name, values in traits.items()})
            for k, surface in enumerate(list(SURFACES.values())[:2])]  # fmt: skip


SOME = list(SURFACES.values())


@pytest.mark.parametrize(
    "subjects, options, error, words",
    [
        (SOME[:1], {}, qc.TemplateError, "1 subjects: .* give at least two"),
        (SOME[0], {}, qc.TemplateError, "give a list of surfaces, or a dict"),
        ([SOME[0], "lh.pial"], {}, qc.TemplateError, "subject 2: 'lh.pial' is no Surface; read"),
        (changed(generation=(2, 3)), {}, qc.TemplateError, "more than one generation .subject 1: 2, subject 2: 3."),
        (changed(hemisphere=("left", "right")), {}, qc.TemplateError, "more than one hemisphere"),
        ({"a": SOME[0], "b": Surface(SOME[1].vertices, SOME[1].faces[:, ::-1])}, {}, SurfaceError, "b: .* inward"),
        ({"a": SOME[0], "b": SOME[1], "c": SOME[0]}, {}, qc.TemplateError, "^a and c are one surface, .*leave one"),
        ({"a": SOME[0], "b": Surface(SOME[1].vertices / 12, SOME[1].faces)}, {}, SurfaceError, "the b .*--units m"),
        (SOME, {"features": ["sulc"]}, FeatureError, "unknown feature 'sulc': depth and curvature are computed"),
        (SOME, {"features": "depth"}, FeatureError, "give a list of them"),
        (SOME, {"features": ["depth", "depth"]}, FeatureError, "named twice"),
        (SOME, {"features": [("sulc", MAPS[0])]}, FeatureError, "a list of 3 arrays, one a subject"),
        (SOME, {"features": [("sulc", [MAPS[0][0]] * 3)]}, FeatureError, "sulc, subject 2: shape"),
        (SOME, {"rounds": -1}, qc.TemplateError, "-1 rounds"),
        (SOME, {"workers": 0}, qc.TemplateError, "0 workers"),
        (SOME, {"delta": 0}, qc.LandmarkError, "delta = 0: the features would take no part"),
    ],
)
def test_what_cannot_be_a_group_is_refused(subjects, options, error, words):
    with pytest.raises(error, match=words):
        qc.template(subjects, **options)


def test_a_subject_of_the_other_side_is_named():
    turned = qc.mirror(SURFACES["bowl 2"])
    with pytest.raises(qc.TemplateError, match="^bowl 2: of the other side than most; mirror them first"):
        qc.template(SURFACES | {"bowl 2": turned}, FEATURES, rounds=0, workers=1)


def test_the_folder_of_another_run_and_one_that_cannot_be_written_are_refused(folder, found, tmp_path):
    with pytest.raises(qc.TemplateError, match="begun with other settings .delta differ.: give the same"):
        of_bowls(folder=folder, delta=0.5)
    (tmp_path / "file").touch()
    with pytest.raises(qc.TemplateError, match="file: cannot be used .File exists.; give another folder"):
        of_bowls(folder=tmp_path / "file")
    (tmp_path / "settings.json").write_text("{")
    with pytest.raises(qc.TemplateError, match="cannot be used"):
        of_bowls(folder=tmp_path)
    (tmp_path / "settings.json").unlink()
    (tmp_path / "round-1-abc.npz").touch()
    with pytest.raises(qc.TemplateError, match="holds files, but no settings.json"):
        of_bowls(folder=tmp_path)


# The command
