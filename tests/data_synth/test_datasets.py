"""Training sets: what an item holds, what decides it, and the file that keeps a drawn set."""

import os
import pickle
from dataclasses import replace

import numpy as np
import pytest
import torch
from skimage import io
from torch.utils.data import DataLoader

from data_synth import CortexError
from data_synth.datasets import CurveDataset, DatasetError, DatasetWarning, cached
from data_synth.fields import MAX_ABS, ImageFolder
from data_synth.training import Fields
from qclearn.plane.grids import pixel_centres, polar_disk
from qclearn.registration.curves import sample_curve
from qclearn.surfaces.curvature import curvature_image
from subjects import grown

# Coarse hemispheres may need a few switched rows; the map is bijective all the same.
pytestmark = pytest.mark.filterwarnings("ignore::qclearn.plane.bijectivity.RepairWarning")

SMALL = {"rings": 8, "spokes": 24}


@pytest.fixture(scope="module")
def subjects():
    return [grown(seed, 1000) for seed in (1, 2)]


@pytest.fixture(scope="module")
def datasets(subjects):
    return {"coefficients": Fields(6, 5, **SMALL), "curves": CurveDataset(6, 5, subjects, size=32)}


each = pytest.mark.parametrize("name", ["coefficients", "curves"])


def same(one, other):
    return all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


@each
def test_an_item_is_its_seeds_and_indexs_alone(datasets, name, subjects):
    dataset = datasets[name]
    forwards = [dataset[k] for k in range(6)]
    assert all(same(dataset[k], forwards[k]) for k in (5, 0, 3))
    for a in range(6):
        for b in range(a):
            assert abs(forwards[a][0] - forwards[b][0]).max() > 1e-2, (a, b)
    other = {"coefficients": lambda: Fields(6, 6, **SMALL), "curves": lambda: CurveDataset(6, 6, subjects, 32)}[name]()
    assert not same(other[0], forwards[0]) and not same(other[0], forwards[1])  # the seed is no offset of the index
    for index in (6, -1):
        with pytest.raises(IndexError):
            dataset[index]


@each
def test_workers_change_nothing_and_a_used_dataset_can_be_sent_to_a_process_that_is_spawned(datasets, name):
    dataset = datasets[name]
    alone, shared = (list(DataLoader(dataset, batch_size=2, num_workers=count)) for count in (0, 2))
    assert all(same(a, b) for a, b in zip(alone, shared, strict=True))
    sent = pickle.dumps(dataset)
    assert same(pickle.loads(sent)[2], dataset[2])
    assert len(sent) < 3e6  # no factorisation comes along


def test_a_coefficient_item_keeps_to_its_range():
    _, faces = polar_disk(8, 24)
    for (mu,) in Fields(10, 1, **SMALL):
        assert mu.dtype == torch.complex64 and mu.shape == (len(faces),)
        assert MAX_ABS[0] <= abs(mu).max() * (1 + 1e-6) and abs(mu).max() <= MAX_ABS[1] * (1 + 1e-6)


def test_both_kinds_of_field_come_in_equal_shares(monkeypatch):
    kinds = []

    def note(disk, rng, kind, **options):
        kinds.append(str(kind))
        return np.full(len(disk.faces), 0.1 + 0j)

    monkeypatch.setattr("data_synth.training.random_coefficient", note)
    dataset = Fields(200, 1, 3, 9)
    for k in range(200):
        dataset.draw(np.random.default_rng(k))
    assert set(kinds) == {"image", "smooth"} and 70 < kinds.count("image") < 130


def test_a_folder_of_images_feeds_the_training_sets(tmp_path):
    for name in "ab":
        io.imsave(tmp_path / f"{name}.png", np.random.default_rng(0).integers(0, 256, (40, 40)).astype(np.uint8))
    pictures, leaves = (Fields(8, 1, **SMALL, **options) for options in ({"source": ImageFolder(tmp_path)}, {}))
    assert all(torch.isfinite(mu).all() for (mu,) in pictures)
    assert 0 < sum(not same(a, b) for a, b in zip(pictures, leaves, strict=True)) < 8  # the smooth kind asks no image


def test_a_curve_item_shows_its_curves(datasets):
    outside = abs(pixel_centres(32)) > 1
    for image, ends, curves in datasets["curves"]:
        assert image.shape == (2, 32, 32) and image.dtype == torch.float32
        assert ends.shape == (8, 2) and curves.shape == (8, 10) and curves.dtype == torch.complex64
        assert torch.equal(ends, curves[:, [0, -1]]) and abs(curves).max() <= 1 + 1e-6
        grey, marks = image.numpy()
        assert grey.min() >= 0 and grey.max() <= 255 and grey[~outside].std() > 30 and (grey[outside] == 0).all()
        # a marked pixel is the one whose centre is nearest an end
        nearest = {int(abs(pixel_centres(32) - complex(end)).argmin()) for end in ends.ravel()}
        assert set(np.flatnonzero(marks.ravel())) == nearest and set(np.unique(marks)) == {0, 255}


def test_curves_lie_in_the_dark_of_their_image(subjects):
    """Fundi are concave, so the image is darker along them: fails if image and curves are turned against each other."""
    share = []
    for image, _, curves in CurveDataset(8, 3, subjects, size=64):
        grey = image[0].numpy()
        row, column = (np.clip((x + 1) * 32, 0, 63).astype(int) for x in (curves.imag.numpy(), curves.real.numpy()))
        share.append(grey[row, column].mean() / grey[abs(pixel_centres(64)) <= 1].mean())
    assert max(share) < 0.8


def test_an_undistorted_item_is_the_subjects_own_image_turned(subjects):
    dataset = CurveDataset(3, 4, subjects[:1], size=32, max_abs=(0.0, 0.0))
    surface, grey, maps, _ = dataset.subjects[0]
    for image, _ends, curves in dataset:
        flat = maps.solve(np.zeros(len(surface.faces)))
        own_image, radius = curvature_image(surface, flat, 32, grey)
        own = np.stack([radius.to_image(sample_curve(surface, surface.curves[name]) @ flat) for name in dataset.names])
        turn = curves.numpy() / own
        assert abs(turn - turn.mean()).max() < 1e-4 and abs(turn.mean()) == pytest.approx(1, abs=1e-5)
        turned, _ = curvature_image(surface, flat * turn.mean(), 32, grey)
        np.testing.assert_allclose(image[0], np.nan_to_num(turned), atol=0.2)
        assert abs(turned - own_image)[abs(pixel_centres(32)) < 0.9].max() > 20


def test_items_come_from_all_subjects_and_from_bijective_maps(subjects, monkeypatch):
    dataset = CurveDataset(12, 7, subjects, size=16)
    seen, flipped = set(), []
    original = type(dataset.subjects[0][2]).solve

    def watch(maps, mu):
        seen.add(len(maps.disk.faces))
        f = original(maps, mu)
        flipped.append(len(maps.disk.at(f).flipped))
        return f

    monkeypatch.setattr(type(dataset.subjects[0][2]), "solve", watch)
    for item in dataset:
        assert torch.isfinite(item[0]).all()
    assert seen == {len(subject.surface.faces) for subject in subjects} and max(flipped) == 0


def test_the_order_of_the_curves_is_that_of_the_names_and_named_ones_are_the_only_ones(subjects):
    first, second = subjects
    backwards = with_curves(first, dict(reversed(first.surface.curves.items())))
    options = {"size": 16, "max_abs": (0.0, 0.0)}
    one, other = (CurveDataset(4, 1, [second, subject], **options) for subject in (first, backwards))
    assert one.names == other.names == tuple(second.curves)
    assert all(same(a, b) for a, b in zip(one, other, strict=True))
    chosen = CurveDataset(2, 1, [second, first], names=["calcarine sulcus", "central sulcus"], **options)
    order = [one.names.index(name) for name in chosen.names]
    assert torch.equal(chosen[1][2], one[1][2][order])


@pytest.mark.parametrize("make, message", [
    (lambda subjects: Fields(0, 1), "count is 0; give a whole number from 1"),
    (lambda subjects: Fields(2.5, 1), "count is 2.5"), (lambda subjects: Fields(3, -1), "seed is -1"),
    (lambda subjects: CurveDataset(3, 1, []), "subjects: give at least one"),
    (lambda subjects: CurveDataset(3, 1, subjects, names=["central sulcus", "silver"]), "silver.*central"),
    (lambda subjects: CurveDataset(3, 1, [subjects[0], with_curves(subjects[1])]), "same named curves"),
    (lambda subjects: CurveDataset(3, 1, [with_curves(subjects[1])]), "named curves"),
    (lambda subjects: CurveDataset(3, 1, [subjects[0], replace(subjects[1], generation=2)]), "generations 2, 3"),
])  # fmt: skip
def test_impossible_sets(subjects, make, message):
    with pytest.raises((DatasetError, CortexError), match=message):
        make(subjects)


def with_curves(subject, curves=None):
    return replace(subject, surface=type(subject.surface)(subject.surface.vertices, subject.surface.faces, curves))


class Counted(Fields):
    """Counts its draws."""

    drawn = 0

    def draw(self, rng):
        self.drawn += 1
        return super().draw(rng)


def counted(count=5, seed=3, rings=4, spokes=12, **options):
    return Counted(count, seed, rings, spokes, **options)


def keep(dataset, path, **options):
    return cached(dataset, path, progress=False, **options)


def test_a_kept_set_is_drawn_once_and_read_back_equal(tmp_path):
    path = tmp_path / "new folder" / "training.set"
    dataset = counted()
    drawn = keep(dataset, path)
    assert dataset.drawn == 5 and len(drawn) == 5
    again = counted()
    read = keep(again, path)
    assert again.drawn == 0
    for k in range(5):
        assert same(drawn[k], dataset[k]) and same(read[k], dataset[k])
    shared, many = keep(counted(20), tmp_path / "workers.set", workers=2), counted(20)  # more than a batch
    assert all(same(shared[k], many[k]) for k in range(20))
    assert os.listdir(path.parent) == ["training.set"]


def test_a_damaged_file_is_drawn_again_with_a_warning(tmp_path):
    path, other = tmp_path / "set.npz", tmp_path / "other.npz"
    keep(counted(), path)
    np.savez(other, vertices=np.zeros(3))
    whole = path.read_bytes()
    for damaged in (whole[:-300], b"no archive", other.read_bytes()):
        path.write_bytes(damaged)
        dataset = counted()
        with pytest.warns(DatasetWarning, match="set.npz is damaged or of another recipe"):
            keep(dataset, path)
        assert dataset.drawn == 5 and path.read_bytes() == whole


@pytest.mark.parametrize(
    "change", [{"count": 6}, {"seed": 4}, {"rings": 3, "spokes": 16}, {"max_abs": (0.05, 0.61)}, {"source": np.ones}]
)
def test_another_recipe_is_drawn_again(tmp_path, change):
    """Three rings of sixteen have as many vertices as four of twelve."""
    path = tmp_path / "set.npz"
    keep(counted(), path)
    assert counted().recipe == counted().recipe != counted(**change).recipe
    if "source" not in change:
        dataset = counted(**change)
        with pytest.warns(DatasetWarning):
            keep(dataset, path)
        assert dataset.drawn == len(dataset)


def test_recipes_see_subjects_and_pictures(subjects, tmp_path):
    first, second = subjects
    curves = first.surface.curves
    shorter = with_curves(first, curves | {"calcarine sulcus": curves["calcarine sulcus"][:-1]})
    recipes = [CurveDataset(2, 1, [subject]).recipe for subject in (first, second, shorter)]
    assert len(set(recipes)) == 3 and CurveDataset(2, 1, [first], points=9).recipe not in recipes

    pictures = []
    for shade in (10, 11):
        io.imsave(tmp_path / "a.png", np.arange(400).reshape(20, 20).astype(np.uint8) // shade, check_contrast=False)
        pictures.append(counted(source=ImageFolder(tmp_path)).recipe)
        assert counted(source=ImageFolder(tmp_path)).recipe == pictures[-1]
    assert pictures[0] != pictures[1] != counted().recipe


def test_nothing_is_drawn_for_a_file_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for path in (tmp_path / "file" / "set.npz", tmp_path / "file" / "deeper" / "set.npz"):
        dataset = counted()
        with pytest.raises(DatasetError, match="cannot be written: .*Choose a folder"):
            keep(dataset, path)
        assert dataset.drawn == 0
    assert (tmp_path / "file").read_text() == "in the way"
    with pytest.warns(DatasetWarning), pytest.raises(DatasetError, match="it is a folder"):
        keep(counted(), tmp_path)
