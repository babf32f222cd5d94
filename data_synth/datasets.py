"""Torch datasets for the three trainings: item k depends on the seed and k alone, whatever the number of workers."""

import hashlib
import os
import tempfile
from pathlib import Path

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, TensorDataset
from tqdm import tqdm

from qclearn.curvature import curvature_image, grey_levels, mean_curvature
from qclearn.disk import BeltramiDiskSolver, disk_conformal_map
from qclearn.diskmesh import polar_disk
from qclearn.landmarks import sample_curve

from .fields import KINDS, random_coefficient
from .landmarks import Perturbation


class _Seeded(Dataset):
    """Items `draw(rng) -> tuple of arrays`, one generator an item, as float32 or complex64 tensors."""

    def __init__(self, count, seed):
        self.count, self.seed = count, seed

    def __len__(self):
        return self.count

    def __getitem__(self, index):
        if not 0 <= index < self.count:
            raise IndexError(index)
        return tuple(_tensor(array) for array in self.draw(np.random.default_rng([self.seed, index])))


def _tensor(array):
    array = np.asarray(array)
    return torch.as_tensor(array.astype(np.complex64 if np.iscomplexobj(array) else np.float32))


class CoefficientDataset(_Seeded):
    """For DBS-Net: (mu (F,), f (V,)) on a polar disk mesh, f the exact map; the two kinds of field in equal shares."""

    def __init__(self, count, seed, rings=32, spokes=96, **options):
        super().__init__(count, seed)
        self.z, self.faces = polar_disk(rings, spokes)
        self.solver, self.options = BeltramiDiskSolver(self.z, self.faces), options

    def draw(self, rng):
        kind = list(KINDS)[rng.integers(len(KINDS))]
        mu = random_coefficient(self.z, self.faces, rng, kind=kind, **self.options)
        return mu, self.solver.solve(mu)


class LandmarkDataset(_Seeded):
    """For CP-Net: (moving (M,), target (M,), mu (F,)) with moving = f(target) for a known map f on a polar mesh.

    targets: (M,) complex landmarks on the control.
    """

    def __init__(self, count, seed, targets, rings=32, spokes=96, **options):
        super().__init__(count, seed)
        self.targets, self.options = np.asarray(targets, complex), options
        self.perturbation = Perturbation(*polar_disk(rings, spokes), self.targets)

    def draw(self, rng):
        kind = list(KINDS)[rng.integers(len(KINDS))]
        moving, mu, _ = self.perturbation.draw(rng, kind=kind, **self.options)
        return moving, self.targets, mu


class CurveDataset(_Seeded):
    """For LD-Net: (image (2, size, size), ends (K, 2), curves (K, points)) of synthetic subjects, turned and distorted.

    Channels: curvature in 0..255 on the disk (0 outside it) and the endpoints as 255; ends and curves are complex
    points of the same image coordinates, whose radius follows the area. Each item draws a subject, a rotation and a
    quasi-conformal map of its disk, as the paper does.
    """

    def __init__(self, count, seed, subjects, size=128, points=10, max_abs=(0.0, 0.4)):
        super().__init__(count, seed)
        self.size, self.points, self.max_abs = size, points, max_abs
        self.subjects = [_prepare(subject) for subject in subjects]

    def draw(self, rng):
        surface, grey, solver = self.subjects[rng.integers(len(self.subjects))]
        mu = random_coefficient(solver.z, solver.faces, rng, max_abs=self.max_abs)
        z = solver.solve(mu) * np.exp(2j * np.pi * rng.random())
        image, radius = curvature_image(surface, z, self.size, grey)
        curves = np.stack([radius.to_image(sample_curve(surface, path, self.points) @ z) for path in surface.curves.values()])
        ends = curves[:, [0, -1]]
        marks = np.zeros((self.size, self.size))
        row, column = (np.clip(((x + 1) * self.size / 2).astype(int), 0, self.size - 1) for x in (ends.imag, ends.real))
        marks[row, column] = 255
        return np.stack([np.nan_to_num(image), marks]), ends, curves


def _prepare(subject):
    surface = subject.surface
    z = disk_conformal_map(surface)
    return surface, grey_levels(mean_curvature(surface), surface.vertex_areas), BeltramiDiskSolver(z, surface.faces)


def cached(dataset, path, workers=0, progress=True):
    """The whole dataset as a TensorDataset, read from `path` or drawn once by `workers` processes and kept there.

    The file carries the dataset's recipe and a checksum; one that is damaged or of another recipe is drawn again.
    """
    path, recipe = Path(path), _recipe(dataset)
    kept = _read(path, recipe)
    if kept is None:
        loader = DataLoader(dataset, batch_size=16, num_workers=workers)
        batches = list(tqdm(loader, desc=f"drawing {path.name}", delay=2, disable=not progress))
        kept = [torch.cat(column) for column in zip(*batches)]
        _write(path, kept, recipe)
    return TensorDataset(*kept)


def _recipe(dataset):
    plain = {key: value for key, value in vars(dataset).items() if isinstance(value, (int, float, str, tuple, dict))}
    targets = getattr(dataset, "targets", np.zeros(0)).tobytes()
    surfaces = b"".join(item[0].vertices.tobytes() for item in getattr(dataset, "subjects", []))
    shape = len(getattr(dataset, "z", ()))
    return hashlib.sha256(repr((type(dataset).__name__, sorted(plain.items()), shape)).encode() + targets + surfaces).hexdigest()


def _checksum(tensors):
    digest = hashlib.sha256()
    for tensor in tensors:
        digest.update(tensor.numpy().tobytes())
    return digest.hexdigest()


def _read(path, recipe):
    try:
        with np.load(path, allow_pickle=False) as file:
            tensors = [torch.as_tensor(file[f"column_{k}"]) for k in range(int(file["columns"]))]
            if file["recipe"] == recipe and file["checksum"] == _checksum(tensors):
                return tensors
    except Exception:  # absent, cut short, or not ours: drawn again
        return None


def _write(path, tensors, recipe):
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".npz", delete=False) as file:
        np.savez(file, columns=len(tensors), recipe=recipe, checksum=_checksum(tensors),
                 **{f"column_{k}": tensor.numpy() for k, tensor in enumerate(tensors)})
    os.replace(file.name, path)
