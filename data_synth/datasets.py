"""Torch datasets for the three trainings: item k depends on the seed and k alone."""

import atexit
import hashlib
import warnings
from errno import EISDIR
from functools import cached_property
from pathlib import Path

import numpy as np
from tqdm import tqdm

from qclearn.io.extras import require
from qclearn.io.safe import write_whole
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import Disk
from qclearn.registration.curves import sample_curve
from qclearn.surfaces.conformal import disk_conformal_map
from qclearn.surfaces.curvature import curvature_image, grey_levels, mean_curvature
from qclearn.surfaces.surface import SurfaceError

from .cortex import require_one_generation
from .fields import random_coefficient
from .landmarks import DiskMaps

with require("nets", "training sets"):
    import torch
    from torch.multiprocessing.reductions import shared_cache
    from torch.utils.data import DataLoader, Dataset, TensorDataset

# Torch remembers each tensor that a worker sent. Unless these references go first, they outlive the
# module that frees them, and the process ends in "Exception ignored in ... StorageWeakRef.__del__".
atexit.register(shared_cache.clear)


class DatasetError(ValueError):
    """A training set that cannot be drawn or stored: says why and what to do."""


class DatasetWarning(UserWarning):
    """A stored training set was damaged or of another recipe, and was drawn again."""


class Seeded(Dataset):
    """Items `draw(rng) -> tuple of arrays`, one generator an item, as float32 or complex64 tensors.

    ingredients: whatever else decides the items (arrays, numbers, names, sources of images), for
    the recipe.
    """

    def __init__(self, count, seed, *ingredients):
        for name, value, least in (("count", count, 1), ("seed", seed, 0)):
            if not isinstance(value, (int, np.integer)) or value < least:
                raise DatasetError(f"the {name} is {value!r}; give a whole number from {least}")
        self.count, self.seed, self.ingredients = int(count), int(seed), ingredients

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        if not 0 <= index < self.count:
            raise IndexError(index)
        return tuple(
            _tensor(array) for array in self.draw(np.random.default_rng([self.seed, index]))
        )

    @property
    def recipe(self):
        """Digest of all that decides the items but the program's version."""
        digest = hashlib.sha256(repr((type(self).__name__, self.count, self.seed)).encode())
        for part in self.ingredients:
            if isinstance(part, np.ndarray):
                digest.update(f"{part.dtype} {part.shape}".encode() + part.tobytes())
            else:
                digest.update(getattr(part, "__qualname__", repr(part)).encode())
            digest.update(b";")
        return digest.hexdigest()


def _tensor(array):
    array = np.asarray(array)
    return torch.as_tensor(array.astype(np.complex64 if np.iscomplexobj(array) else np.float32))


def quiet_disk_map(surface):
    """The disk map of a subject, without warnings of raised boundary steps."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        return disk_conformal_map(surface)


class CurveDataset(Seeded):
    """For LD-Net: (image (2, size, size), ends (K, 2), curves (K, points)) of synthetic subjects.

    Channels: curvature in 0..255 on the disk (0 outside it) and the endpoints as 255; ends and
    curves are complex points of the same image coordinates, whose radius follows the area. Each
    item draws a subject, a rotation and a quasi-conformal map of its disk, as the paper does. The
    curves are the subjects' own, in the order of `names` (all of the first subject's unless some
    are named).
    """

    def __init__(self, count, seed, subjects, size=128, points=10, max_abs=(0.0, 0.4), names=None):
        surfaces = [subject.surface for subject in subjects]
        known = tuple(surfaces[0].curves) if surfaces else ()
        if not known or any(set(surface.curves) != set(known) for surface in surfaces):
            raise DatasetError("subjects: give at least one, all with the same named curves")
        require_one_generation(subjects)
        self.names = known if names is None else tuple(names)
        unknown = [name for name in self.names if name not in known]
        if unknown or not self.names:
            raise DatasetError(
                f"names: no sulcus is called {unknown}; the subjects have {', '.join(known)}"
            )
        parts = [
            part
            for surface in surfaces
            for part in (
                surface.vertices,
                surface.faces,
                *(surface.curves[name] for name in self.names),
            )
        ]
        super().__init__(count, seed, size, points, max_abs, self.names, *parts)
        self.size, self.points, self.max_abs, self.surfaces = size, points, max_abs, surfaces

    @cached_property
    def subjects(self):
        """The sources of the items, prepared at first use: most of a second each."""
        return [self._prepare(surface) for surface in self.surfaces]

    def _prepare(self, surface):
        samples = [sample_curve(surface, surface.curves[name], self.points) for name in self.names]
        grey = grey_levels(mean_curvature(surface), surface.vertex_areas)
        return surface, grey, DiskMaps(Disk(quiet_disk_map(surface), surface.faces)), samples

    def draw(self, rng):
        surface, grey, maps, samples = self.subjects[rng.integers(len(self.subjects))]
        mu = random_coefficient(maps.disk, rng, max_abs=self.max_abs)
        z = maps.solve(mu) * np.exp(2j * np.pi * rng.random())
        image, radius = curvature_image(surface, z, self.size, grey)
        curves = np.stack([radius.to_image(curve @ z) for curve in samples])
        ends = curves[:, [0, -1]]
        marks = np.zeros((self.size, self.size))
        row, column = (
            np.clip(((x + 1) * self.size / 2).astype(int), 0, self.size - 1)
            for x in (ends.imag, ends.real)
        )
        marks[row, column] = 255
        return np.stack([np.nan_to_num(image), marks]), ends, curves


def cached(dataset, path, workers=0, progress=True):
    """The whole dataset as a TensorDataset, read from `path` or drawn and stored there.

    The file carries the dataset's recipe; one that cannot be read or is of another recipe is drawn
    again, with a DatasetWarning. DatasetError, before anything is drawn, where the file cannot be
    written.
    """
    path = Path(path)
    columns = _read(path, dataset.recipe)
    if columns is None:
        if path.exists():
            warnings.warn(
                f"{path} is damaged or of another recipe; it is drawn again",
                DatasetWarning,
                stacklevel=2,
            )
        columns = _drawn(dataset, path, workers, progress)
    return TensorDataset(*columns)


def _drawn(dataset, path, workers, progress):
    """The columns of a dataset, drawn and written to `path`, whole or not at all."""
    drawn = []

    def draw(place):
        loader = DataLoader(dataset, batch_size=16, num_workers=workers)
        batches = list(
            tqdm(loader, desc=f"drawing {path.name}", delay=2, disable=not progress or None)
        )
        drawn.extend(torch.cat(column) for column in zip(*batches))
        columns = {f"column_{k}": tensor.numpy() for k, tensor in enumerate(drawn)}
        with place.open("wb") as file:
            np.savez(file, columns=len(drawn), recipe=dataset.recipe, **columns)

    try:
        if path.is_dir():
            raise IsADirectoryError(EISDIR, "it is a folder")
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise DatasetError(
            f"{path} cannot be written: {reason}. Choose a folder you may write."
        ) from None
    try:
        write_whole(path, draw)
    except SurfaceError as error:
        raise DatasetError(str(error)) from None
    return drawn


def _read(path, recipe):
    try:
        # Opened here: np.load leaves the file open where the archive is damaged.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            tensors = [torch.as_tensor(file[f"column_{k}"]) for k in range(int(file["columns"]))]
            return tensors if file["recipe"] == recipe else None
    except Exception:
        return None
