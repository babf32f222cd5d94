"""Random Beltrami coefficients: their size, their spectra, the paper's recipe over a folder of images; landmarks."""

import shutil

import numpy as np
import pytest
from scipy import stats
from skimage import io

from data_synth.fields import (
    KINDS,
    MAX_ABS,
    ImageError,
    ImageFolder,
    dead_leaves,
    image_coefficient,
    power_noise,
    random_coefficient,
    smooth_coefficient,
)
from data_synth.landmarks import DiskMaps, Perturbation
from qclearn.plane.disk import Disk
from qclearn.plane.grids import disk_to_square, polar_disk
from qclearn.plane.solver import DiskSolver
from qclearn.registration.fit import fit_landmarks

DISK = Disk(*polar_disk(12, 36))


def photograph(height, width, seed, channels=3):
    """Grey structures of one phase all over, so that its parts differ, as bytes (height, width, channels)."""
    y, x = np.mgrid[:height, :width]
    rng = np.random.default_rng(seed)
    waves = sum(np.sin(rng.normal(size=2) @ np.stack([x, y]).reshape(2, -1) / 3).reshape(x.shape) for _ in range(4))
    grey = (127.5 + 31 * waves).astype(np.uint8)
    return np.repeat(grey[..., None], channels, axis=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photographs")
    io.imsave(folder / "wide.png", photograph(40, 70, 1))
    io.imsave(folder / "tall.JPG", photograph(90, 30, 2))
    io.imsave(folder / "grey.tif", photograph(50, 50, 3)[..., 0])
    (folder / "notes.txt").write_text("no picture")
    return folder


def slope_of_amplitude(draw, size=128, count=24):
    """Minus the slope of log amplitude over log |k|, from the power averaged over draws."""
    k = np.hypot(*np.meshgrid(*[np.fft.fftfreq(size) * size] * 2, indexing="ij"))
    window = np.outer(*[np.hanning(size)] * 2)  # opposite sides differ: without it the jump gives slope 1 to anything
    power = sum(abs(np.fft.fft2(draw(np.random.default_rng(s)) * window)) ** 2 for s in range(count))
    rings = np.arange(4, 25)
    means = [np.log(power[(k >= ring - 0.5) & (k < ring + 0.5)].mean()) / 2 for ring in rings]
    return -np.polyfit(np.log(rings), means, 1)[0]


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.0])
def test_noise_has_the_amplitude_that_it_is_asked_for(slope):
    assert slope_of_amplitude(lambda rng: power_noise(128, rng, slope)) == pytest.approx(slope, abs=0.1)
    noise = power_noise(65, np.random.default_rng(1), slope)
    assert noise.shape == (65, 65) and noise.std() == pytest.approx(1) and noise.mean() == pytest.approx(0, abs=1e-12)


def test_dead_leaves_have_the_spectrum_of_natural_images():
    assert slope_of_amplitude(lambda rng: dead_leaves(128, rng)) == pytest.approx(1.2, abs=0.2)  # Ruderman: 0.9 to 1.4
    image = dead_leaves(64, np.random.default_rng(0))
    assert image.shape == (64, 64) and image.min() >= 0 and image.max() <= 1 and image.std() > 0.1


def test_dead_leaves_have_edges_and_their_noise_has_none():
    def kurtosis(draw):
        return np.mean([stats.kurtosis(np.diff(draw(np.random.default_rng(s)), axis=1), axis=None) for s in range(8)])

    assert abs(kurtosis(lambda rng: power_noise(64, rng, 1.0))) < 0.5
    assert kurtosis(lambda rng: dead_leaves(64, rng)) > 3


def test_smooth_fields_have_the_spectrum_of_smooth_deformations():
    assert slope_of_amplitude(lambda rng: smooth_coefficient(128, rng)) == pytest.approx(2.5, abs=0.15)


def test_opposite_sides_of_smooth_fields_are_free():
    field = np.stack([smooth_coefficient(64, np.random.default_rng(s)) for s in range(20)])
    across = abs(field[:, 0] - field[:, -1]).mean()
    assert across > 10 * abs(field[:, 0] - field[:, 1]).mean()


def test_images_become_the_two_parts_smoothed_with_noise():
    first, second = (dead_leaves(64, np.random.default_rng(s)) for s in (1, 2))
    given = [first, second]
    field = image_coefficient(64, np.random.default_rng(0), lambda size, rng: given.pop(0), (0.02, 0.02), 0.0)
    for part, other, image in ((field.real, field.imag, first), (field.imag, field.real, second)):
        assert np.corrcoef(part.ravel(), image.ravel())[0, 1] > 0.8
        assert abs(np.corrcoef(other.ravel(), image.ravel())[0, 1]) < 0.5
        assert abs(np.diff(part / part.std())).mean() < 0.5 * abs(np.diff(image / image.std())).mean()
    assert abs(field).max() == pytest.approx(1) and abs(field.mean()) < 1e-12


def test_added_noise_has_the_stated_share():
    def draw(noise):
        return image_coefficient(64, np.random.default_rng(5), smoothing=(0.1, 0.1), noise=noise)

    clean, noisy = draw(0.0), draw(0.1)
    scale = (noisy * clean.conj()).sum().real / (abs(clean) ** 2).sum()
    added = noisy - scale * clean
    assert np.sqrt((abs(added) ** 2).mean() / (abs(scale * clean) ** 2).mean()) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_the_largest_size_is_uniform_in_its_interval(kind):
    largest = [abs(random_coefficient(DISK, np.random.default_rng(s), kind=kind, size=24)).max() for s in range(150)]
    low, high = MAX_ABS
    assert low <= min(largest) and max(largest) <= high < 1
    assert stats.kstest(largest, stats.uniform(low, high - low).cdf).pvalue > 0.01
    fixed = random_coefficient(DISK, np.random.default_rng(0), kind=kind, size=24, max_abs=(0.3, 0.3))
    assert abs(fixed).max() == pytest.approx(0.3) and fixed.shape == (len(DISK.faces),)


def right_half(size, rng):
    return np.broadcast_to(np.arange(size) >= size / 2, (size, size)).astype(float)


def test_no_direction_is_preferred():
    """Both parts from one picture: without the turn, mu would point along one diagonal."""
    options = {"kind": "image", "size": 24, "source": right_half}
    at_zero = [random_coefficient(DISK, np.random.default_rng(s), **options)[0] for s in range(150)]
    assert stats.kstest(np.angle(at_zero), stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.01


def test_fields_lie_on_the_disk_as_on_the_square():
    """A source that is white on the right half only: mu is there, whatever its phase."""
    mu = random_coefficient(DISK, np.random.default_rng(3), kind="image", size=64, source=right_half)
    x = disk_to_square(DISK.centroids).real
    # mean 0, so the halves are opposite; the smoothing is at most 0.06 of the size
    turn = mu[x > 0.3].mean() / abs(mu[x > 0.3].mean())
    assert ((mu[x > 0.3] / turn).real > 0).all() and ((mu[x < -0.3] / turn).real < 0).all()


@pytest.mark.parametrize("options, message", [
    ({"kind": "photo"}, "unknown kind 'photo'; there are image, smooth"), ({"max_abs": (0.2, 1.0)}, "within"),
    ({"max_abs": (0.5, 0.2)}, "within"), ({"max_abs": (-0.1, 0.2)}, "within"),
])  # fmt: skip
def test_impossible_fields(options, message):
    with pytest.raises(ValueError, match=message):
        random_coefficient(DISK, np.random.default_rng(0), **options)


def test_a_folder_gives_square_parts_of_all_its_pictures(folder):
    source = ImageFolder(folder)
    assert len(source.paths) == 3
    parts = np.stack([source(32, np.random.default_rng(s)) for s in range(30)])
    assert parts.shape == (30, 32, 32) and parts.min() >= 0 and parts.max() <= 1
    assert parts.std(axis=(1, 2)).min() > 0.05
    assert len({part.tobytes() for part in parts}) == 30


def test_a_part_keeps_the_proportions_and_the_orientation(tmp_path):
    y, x = np.mgrid[:60, :200]
    io.imsave(tmp_path / "ramp.png", (y + x).astype(np.uint8)[..., None].repeat(3, 2), check_contrast=False)
    for seed in range(10):
        part = ImageFolder(tmp_path)(20, np.random.default_rng(seed))
        down, right = (np.diff(part, axis=axis)[3:-3, 3:-3].mean() for axis in (0, 1))
        assert down == pytest.approx(right, rel=0.05) and 0.5 / 1.05 <= down * 255 / (60 / 20) <= 1.05


def test_the_papers_recipe_over_a_folder(folder):
    options = {"kind": "image", "source": ImageFolder(folder)}
    mu = [random_coefficient(DISK, np.random.default_rng(s), **options) for s in (1, 1, 2)]
    assert np.array_equal(mu[0], mu[1]) and abs(mu[0] - mu[2]).max() > 0.05
    assert np.isfinite(mu[0]).all() and MAX_ABS[0] <= abs(mu[0]).max() <= MAX_ABS[1]
    assert DISK.certify(DiskSolver(DISK).solve(mu[0])).bijective


@pytest.mark.parametrize("channels", [2, 4])
def test_opacity_is_no_part_of_the_picture(tmp_path, channels):
    grey = photograph(30, 30, 4, 1)
    opaque = np.concatenate([grey.repeat(channels - 1, 2), np.full((30, 30, 1), 7, np.uint8)], 2)
    io.imsave(tmp_path / "opaque.png", opaque, check_contrast=False)
    plain = tmp_path / "plain"
    plain.mkdir()
    io.imsave(plain / "grey.png", grey[..., 0])
    one, other = (ImageFolder(path)(16, np.random.default_rng(0)) for path in (tmp_path, plain))
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_part_of_one_grey_is_not_used(tmp_path):
    """A sky over a thin coast: most parts have no contrast, and two of them would leave nothing to scale."""
    sky = np.full((200, 40), 200, np.uint8)
    sky[-2:] = 10
    io.imsave(tmp_path / "sky.png", sky, check_contrast=False)
    for seed in range(5):
        mu = random_coefficient(DISK, np.random.default_rng(seed), kind="image", size=32, source=ImageFolder(tmp_path))
        assert np.isfinite(mu).all() and abs(mu).max() >= MAX_ABS[0]


def test_the_name_of_a_folder_tells_its_pictures_apart(folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    assert repr(ImageFolder(copy)) == repr(ImageFolder(folder))
    io.imsave(copy / "wide.png", photograph(40, 70, 9))
    assert repr(ImageFolder(copy)) != repr(ImageFolder(folder))


@pytest.mark.parametrize("name, picture, words", [
    ("z.png", b"no picture", "remove or replace"), ("z.png", b"", "remove or replace"),
    ("z.png", photograph(5, 40, 1), "remove or replace|give one picture"),
    ("z.png", np.zeros((20, 20), np.uint8), "remove or replace|give one picture"),
    ("z.tif", np.full((20, 20), np.nan, np.float32), "remove or replace|give one picture"),
])  # fmt: skip
def test_the_first_unusable_picture_is_named_at_the_start(folder, tmp_path, name, picture, words):
    path = shutil.copytree(folder, tmp_path / "copy") / name
    path.write_bytes(picture) if isinstance(picture, bytes) else io.imsave(path, picture, check_contrast=False)
    with pytest.raises(ImageError, match=f"{name}: .*({words})"):
        ImageFolder(path.parent)


def test_folders_without_pictures(tmp_path):
    (tmp_path / "file.png").touch()
    (tmp_path / "empty").mkdir()
    for name, words in (("empty", "holds no images"), ("absent", "no such folder"), ("file.png", "no such folder")):
        with pytest.raises(ImageError, match=words):
            ImageFolder(tmp_path / name)


@pytest.mark.digits
def test_maps_that_keep_nothing_are_the_solvers():
    maps = DiskMaps(DISK)
    for seed in (0, 1):
        mu = random_coefficient(DISK, np.random.default_rng(seed))
        assert np.array_equal(maps.solve(mu), DiskSolver(DISK).solve(mu))
    assert not hasattr(maps._solver, "free_boundary")


def test_landmarks_are_moved_by_the_map_that_is_returned():
    corners = np.array([5, 60, 200])
    p, mu, f = Perturbation(DISK, DISK.z[corners]).draw(np.random.default_rng(4), max_abs=(0.3, 0.3))
    np.testing.assert_allclose(p, f[corners], atol=1e-12)
    assert abs(p - DISK.z[corners]).min() > 1e-3
    measured = DISK.coefficient(f)
    assert abs(measured - mu).mean() < 0.2 * abs(mu).mean() < 0.2 * abs(measured - mu.conj()).mean()


def test_a_perturbation_can_be_undone():
    rng = np.random.default_rng(8)
    q = 0.7 * np.sqrt(rng.random(25)) * np.exp(2j * np.pi * rng.random(25))
    z, faces = polar_disk(24, 72)
    p, _, _ = Perturbation(Disk(z, faces), q).draw(rng, max_abs=(0.4, 0.4))
    fit = fit_landmarks(z, faces, p, q)
    assert fit.bijective and fit.landmark_error < 0.05 * abs(p - q).mean()
