"""Per-vertex files: masks of what to cut away, and maps to carry from one surface to another."""

import gzip
from pathlib import Path

import nibabel
import numpy as np

from . import meshformats
from .files import explain, read_bytes, suffix_of, write_whole
from .surface import SurfaceError


def read_mask(path, surface, keep=False):
    """Mask (V,) bool of the vertices to cut away: those a file names or gives a nonzero value; for open_surface.

    Files: a FreeSurfer .label (vertex numbers), or one number a vertex as .npy, .txt, .gii (also gzipped) or FreeSurfer
    morphometry (lh.thickness, by any other name). keep=True: the file says what to keep (lh.cortex.label, thickness),
    so all else is cut. Raises SurfaceError, also where more than half would be cut although keep was not asked for.
    """
    path = Path(path)
    n_vertices = len(surface.vertices)
    if suffix_of(path) == ".label":
        with explain(path, "FreeSurfer label"):
            values = _read_label(path, read_bytes(path))
        bad = values[(values < 0) | (values >= n_vertices)]
        if bad.size:
            raise SurfaceError(f"{path}: names vertices that do not exist, the first {bad[0]}; {_other(n_vertices)}")
        mask = np.bincount(values, minlength=n_vertices) > 0
    else:
        values = read_values(path)
        if values.shape != (n_vertices,):
            raise SurfaceError(f"{path}: holds values of the shape {values.shape}; {_other(n_vertices)}")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise SurfaceError(f"{path}: is NaN or infinite at {len(bad)} vertices, the first {bad[0]}; use 0 and 1.")
        mask = values != 0
    if keep:
        return ~mask
    if mask.sum() > n_vertices / 2:
        raise SurfaceError(
            f"{path}: would cut {mask.sum()} of {n_vertices} vertices, so it seems to say what to keep, as "
            f"lh.cortex.label and thickness do; read it with keep=True (`qclearn open --keep`), or give the other part."
        )
    return mask


def read_values(path):
    """Values (V, ...) of a per-vertex file: .npy, .txt, .gii (also gzipped), or FreeSurfer morphometry by any other name.

    SurfaceError, naming the file and the remedy, where it cannot be read.
    """
    path = Path(path)
    data = read_bytes(path)
    kind, reader = _READERS.get(suffix_of(path), ("FreeSurfer morphometry file", _read_morphometry))
    with explain(path, kind):
        return np.asarray(reader(path, data))


def write_values(path, values):
    """Write values (V,) in the format of the path's suffix, as `read_values` reads them; whole or not at all.

    GIFTI and FreeSurfer morphometry store float32; GIFTI keeps integers as int32. SurfaceError if it cannot be written.
    """
    path = Path(path)
    write_whole(path, lambda temporary: _WRITERS.get(suffix_of(path), _write_morphometry)(temporary, np.asarray(values)))


def _other(n_vertices):
    return f"the surface has {n_vertices} vertices: take the file that belongs to this surface, or copy it again."


def _read_label(path, data):
    announced = int(data.splitlines()[1])
    indices = np.atleast_1d(nibabel.freesurfer.read_label(path)) if announced else np.empty(0, dtype=int)
    meshformats.require_all("vertex", len(indices), announced)
    return indices


def _read_morphometry(path, data):
    values = nibabel.freesurfer.read_morph_data(path)
    meshformats.require_all("value", len(values), int.from_bytes(data[3:7], "big"))  # nibabel takes what it finds
    return values


def _read_gifti_values(_, data):
    arrays = nibabel.GiftiImage.from_bytes(data).darrays
    if len(arrays) != 1:
        raise SurfaceError(f"holds {len(arrays)} data arrays; give a GIFTI file with one value a vertex.")
    return arrays[0].data


def _read_npy(path, _):
    return np.load(path, allow_pickle=False)


def _read_txt(path, _):
    return np.loadtxt(path, ndmin=1)


def _write_npy(path, values):
    with path.open("wb") as file:
        np.save(file, values)


def _write_txt(path, values):
    np.savetxt(path, values, fmt="%d" if values.dtype.kind in "iub" else "%.17g")


def _write_gifti_values(path, values):
    whole = values.dtype.kind in "iub"
    array = nibabel.gifti.GiftiDataArray(values.astype(np.int32 if whole else np.float32),
                                         intent="NIFTI_INTENT_LABEL" if whole else "NIFTI_INTENT_SHAPE")
    data = nibabel.GiftiImage(darrays=[array]).to_bytes()
    path.write_bytes(gzip.compress(data, mtime=0) if path.suffix.lower() == ".gz" else data)


def _write_morphometry(path, values):
    nibabel.freesurfer.write_morph_data(path, values)


_READERS = {
    ".npy": ("NumPy array", _read_npy),
    ".txt": ("text file of one number a vertex", _read_txt),
    ".gii": ("GIFTI data file", _read_gifti_values),
}
_WRITERS = {".npy": _write_npy, ".txt": _write_txt, ".gii": _write_gifti_values}
