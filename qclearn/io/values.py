"""Per-vertex files: masks of what to cut away, and maps to carry from one surface to another."""

import io
import math
import re
from functools import partial
from itertools import dropwhile
from pathlib import Path
from typing import NamedTuple

import nibabel
import numpy as np
from jaxtyping import Bool, Real
from numpy import ndarray

from ..plane.checks import unmasked
from ..surfaces.surface import Mesh, Surface, SurfaceError, require_surface
from . import annotations, foreign, gifti
from .frames import agreed_side, side_of_name
from .meshes import is_freesurfer_name, suffix_of
from .safe import FormatError, explain, printable, read_bytes, require_all, write_whole

_MAP_SUFFIXES = (
    "", ".thickness", ".curv", ".avg_curv", ".sulc", ".area", ".volume", ".mid", ".pial", ".w-g",
    ".pct",
)  # fmt: skip
_FORMATS = ".npy, .txt, .gii (shape, func, label, also gzipped), .mgh, .mgz, .annot or FreeSurfer morphometry"
# Formats that are known and not read or written here: what to do instead.
_REFUSED = {
    ".nii": foreign.NIFTI,
    ".label": "a label lists vertices and gives no value to each: `qclearn open --mask` takes it",
    ".npz": "an npz holds several arrays: save one as .npy",
    **dict.fromkeys((".vtk", ".vtp"), "numpy.save('OUT.npy', pyvista.read(IN).point_data['NAME'])"),
}

# FreeSurfer's type of an MGH's numbers -> NumPy's.
_MGH_TYPES = {0: ">u1", 1: ">i4", 3: ">f4", 4: ">i2", 10: ">u2"}

# One number a vertex, or k of them.
Values = Real[ndarray, " V *k"] | Bool[ndarray, " V *k"]


def read_mask(path: str | Path, surface: Surface | Mesh, keep: bool = False) -> Bool[ndarray, " V"]:
    """Mask of the vertices to cut away: those that a file names or gives a nonzero value.

    Files: a FreeSurfer .label, or one number a vertex as of `read_values`. keep=True: the file says
    what to keep (lh.cortex.label, thickness). SurfaceError, also for an .annot, and for more than
    half of the vertices without keep.
    """
    require_surface(surface, Mesh)
    path = Path(path)
    n_vertices = len(surface.vertices)
    other = f"the surface has {n_vertices} vertices: take the file that belongs to this surface, or copy it again"
    if suffix_of(path) == ".label":
        values = read_label(path)
        bad = values[(values < 0) | (values >= n_vertices)]
        if bad.size:
            message = f"names vertices that do not exist, the first {bad[0]}"
            raise SurfaceError(f"{path}: {message}; {other}")
        mask = np.bincount(values, minlength=n_vertices) > 0
    elif suffix_of(path) == ".annot":
        advice = "give lh.cortex.label with --keep, or a mask"
        raise SurfaceError(f"{path}: an annotation does not say which regions to cut; {advice}")
    else:
        values = read_values(path)
        if values.shape != (n_vertices,):
            message = f"holds values of the shape {values.shape}"
            raise SurfaceError(f"{path}: {message}; {other}")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            message = f"is NaN or infinite at {len(bad)} vertices, the first {bad[0]}"
            raise SurfaceError(f"{path}: {message}; use 0 and 1")
        mask = values != 0
    if keep:
        return ~mask
    if mask.sum() > n_vertices / 2:
        raise SurfaceError(
            f"{path}: would cut {mask.sum()} of {n_vertices} vertices, so it seems to say what "
            "to keep, as lh.cortex.label and thickness do; read it with keep=True "
            "(`qclearn open --keep`), or give the other part"
        )
    return mask


class Map(NamedTuple):
    """What a per-vertex file holds: values (V,) or (V, k), and, or None, what it says of them.

    side: "left" or "right"; labels: key -> (name, (r, g, b, a) from 0 to 1); names: of the maps;
    integer: which of the k maps hold whole numbers, where others, floats, stand beside them.
    """

    values: np.ndarray
    side: str | None = None
    labels: dict | None = None
    names: list | None = None
    integer: list | None = None

    @property
    def is_integer(self):
        """Whether a map is of a type of whole numbers, as labels are."""
        return self.values.dtype.kind in "biu" or bool(self.integer)


def read_label(path):
    """The vertex numbers (n,) that a FreeSurfer .label file lists, in its order."""
    path = Path(path)
    with explain(path, "FreeSurfer label"):
        # Comments, of which there may be none, the count, and one row a vertex.
        rows = filter(None, map(bytes.split, read_bytes(path).splitlines()))
        count, *records = [*dropwhile(lambda row: len(row) > 1 or row[0] == b"#", rows)] or [[b""]]
        require_all("vertex", len(records), int(count[0]), exactly=True)
        return np.array([int(record[0]) for record in records], dtype=np.int64)


def read_values(path: str | Path) -> Values:
    """Values (V,), or (V, k) of k maps, of a per-vertex file: .npy, .txt, .gii (.shape, .func,
    .label, also gzipped), .mgh, .mgz, .annot, or FreeSurfer morphometry, known by its content under
    any other name.

    Integers stay integers: in .npy, a text without a point, GIFTI's and MGH's integer types, and an
    annotation (indices of its table, -1 for none). SurfaceError, naming the file and the remedy,
    where it cannot be read.
    """
    return read_map(path).values


def read_map(path):
    """The `Map` of a file that `read_values` reads."""
    path = Path(path)
    suffix = suffix_of(path)
    foreign.refuse_foreign(path)
    _require_known(path, suffix, "read")
    data = read_bytes(path)
    if suffix not in _READERS:
        held = foreign.freesurfer_kind(data)
        if held != foreign.MAP:
            held = held or f"not read here; convert it to one of {_FORMATS}"
            raise SurfaceError(f"{path}: {held}")
    kind, reader = _READERS.get(suffix, ("FreeSurfer morphometry file", _read_morphometry))
    with explain(path, kind):
        result = reader(path, data)
        if suffix == ".annot":
            result = Map(result[0], side_of_name(path), result[1])
        elif suffix != ".gii":
            result = Map(result, side_of_name(path))
        values = np.asarray(result.values)
        if values.ndim > 1:  # (V, 1), (1, V), and an MGH's (V, 1, 1, k)
            values = np.atleast_1d(values.squeeze())
        if values.dtype.kind not in "biuf":
            advice = "save one real number a vertex"
            raise SurfaceError(f"holds {values.dtype}, not real numbers; {advice}")
        if values.ndim not in (1, 2) or not values.size:
            advice = "save one number a vertex"
            raise SurfaceError(f"holds the shape {values.shape}, not (V,) or (V, k); {advice}")
    return result._replace(values=values.astype(values.dtype.newbyteorder("=")))


def _read_gifti(path, data):
    image = gifti.parse(path, data)
    names = [array.meta.get("Name", "") for array in gifti.maps_of(image)]
    side = agreed_side(path, gifti.side_of_image(image))
    labels = gifti.labels_of(image) or None
    values, integer = gifti.values_of(image)
    return Map(values, side, labels, names if all(names) else None, integer)


def write_values(
    path: str | Path,
    values: Values,
    side: str | None = None,
    labels: dict | None = None,
    names: list | None = None,
    integer: list | None = None,
) -> None:
    """Write values (V,) or (V, k), whole or not at all, in the format of the path's suffix.

    GIFTI, MGH and morphometry store float32, GIFTI and MGH integers as int32; morphometry and
    .annot take (V,) alone. A GIFTI gets the hemisphere, side = "left" or "right" (else by its
    name), names of the k maps (else by its name), and for integers the table `labels`, key ->
    (name, (r, g, b, a) from 0 to 1), as an .annot does. Key -1, none, becomes 0 in a .label.gii.
    integer: which of k maps of floats a GIFTI holds as integers.
    SurfaceError where format, numbers or folder do not allow it.
    """
    path = Path(path)
    values = unmasked(values, path, SurfaceError)
    suffix = suffix_of(path)
    _require_known(path, suffix, "written")
    if values.dtype.kind not in "biuf" or values.ndim not in (1, 2):
        advice = "give (V,) or (V, k), real and imaginary apart"
        raise SurfaceError(f"{path}: {values.dtype} {values.shape} cannot be written; {advice}")
    with explain(path, "name"):
        side = agreed_side(path, side)
    if suffix == ".gii":
        names = names or gifti.names_of(path, values)
        columns = list(_fitting(path, values).reshape(len(values), -1).T)
        for k in np.flatnonzero(integer or []):
            columns[k] = _fitting(path, values[:, k].astype(np.int64))
        with explain(path, "label table"):
            is_metric = any(part.lower() in (".func", ".shape") for part in path.suffixes)
            keys = [column for column in columns if column.dtype.kind == "i"]
            table = gifti.table_of(np.stack(keys), labels) if keys and not is_metric else None
            data = gifti.values_bytes(columns, side, table, names)
        write = partial(Path.write_bytes, data=gifti.zipped(path, data))
    elif suffix in (".mgh", ".mgz"):
        voxels = _fitting(path, values).reshape(len(values), 1, 1, *values.shape[1:])
        data = nibabel.MGHImage(voxels, np.eye(4)).to_bytes()
        write = partial(Path.write_bytes, data=gifti.zipped(path, data))
    elif suffix == ".annot":
        if values.dtype.kind not in "biu" or values.ndim != 1 or values.min() < -1:
            wanted = "one label a vertex, a whole number from 0 on, or -1 for none"
            raise SurfaceError(f"{path}: an annotation holds {wanted}")
        write = partial(annotations.write, values=values, labels=gifti.table_of(values, labels))
    elif suffix in _MAP_SUFFIXES or is_freesurfer_name(path, suffix):
        numbers = _fitting(path, values, integer=False)
        write = partial(nibabel.freesurfer.write_morph_data, values=numbers)
    elif suffix == ".npy":
        np.save(data := io.BytesIO(), values)
        write = partial(Path.write_bytes, data=data.getvalue())
    elif suffix == ".txt":
        write = partial(np.savetxt, X=values, fmt="%d" if values.dtype.kind in "iub" else "%.17g")
    else:
        message = f"not a format that is written here: {_FORMATS}"
        raise SurfaceError(f"{path}: {message}; choose another name")
    write_whole(path, write)


def _require_known(path, suffix, done):
    known = ".nii" if path.name.lower().endswith(".nii.gz") else suffix
    if known in _REFUSED:
        raise SurfaceError(f"{path}: {known} files are not {done} here; {_REFUSED[known]}")


def _fitting(path, values, integer=True):
    """Values as int32 or float32 (integer=False: float32 alone); SurfaceError where one changes."""
    if values.ndim == 2 and not integer:
        message = f"morphometry holds one map, not {values.shape[1]}"
        raise SurfaceError(f"{path}: {message}; choose .mgh or .func.gii")
    integers = values.dtype.kind in "biu"
    # float32 has every integer up to 2^24
    largest = np.iinfo(np.int32).max if integer else 1 << 24
    largest = largest if integers else float(np.finfo(np.float32).max)
    bad = np.argwhere(np.isfinite(values) & ((values > largest) | (values < -largest)))
    if bad.size:
        value = values[tuple(bad[0])]
        message = f"{value} at vertex {bad[0][0]} does not fit the format (up to {largest:.10g})"
        raise SurfaceError(f"{path}: {message}; choose .npy or .txt")
    return values.astype(np.int32 if integers and integer else np.float32)


def _read_morphometry(_, data):
    count, _, each = np.frombuffer(data[3:15].ljust(12, b"\0"), ">i4").tolist()
    if each != 1:
        raise FormatError(f"it holds {each} values a vertex, where one is read")
    require_all("value", (len(data) - 15) / 4, count, exactly=True)
    return np.frombuffer(data, ">f4", offset=15)


def _read_mgh(_, data):
    """nibabel refuses an intent in the version's second byte, as FreeSurfer writes since 7.4."""
    version, *shape, kind = np.frombuffer(data, ">i4", 6).tolist()
    if version % 256 != 1 or min(shape) < 1:
        raise FormatError(f"version {version}, shape {shape}")
    if kind not in _MGH_TYPES:
        advice = "convert them: mri_convert -odt float IN OUT"
        raise SurfaceError(f"holds numbers of FreeSurfer's type {kind}, not read here; {advice}")
    if min(shape[:3]) > 1:  # FreeSurfer folds a long map into (V / 6, 1, 6)
        volume = " x ".join(map(str, shape[:3]))
        raise SurfaceError(f"holds a volume of {volume}, not a map on a surface; use mri_vol2surf")
    voxels = np.frombuffer(data, _MGH_TYPES[kind], math.prod(shape), offset=284)
    return voxels.reshape(math.prod(shape[:3]), -1, order="F")


def _read_npy(_, data):
    file = io.BytesIO(data)
    array = np.lib.format.read_array(file, allow_pickle=False)
    require_all("byte", len(data), file.tell(), exactly=True)
    return array


def _read_txt(_, data):
    # comments, but not 1.#QNAN of Windows; NA as R, NULL and None as others write it
    text = "\n".join(re.sub(r"(^|\s)#.*", "", line) for line in data.decode().splitlines())
    text = re.sub(r"\b(NA|N/A|NULL|None)\b", "nan", text)
    lines = [line for line in text.splitlines() if line.strip()] or [""]
    # A line of names may stand above one column. What else looks like a table may mean anything.
    above = re.match(r"(?i)[\W_]*(?!(nan|inf(inity)?)\b)[^\W\d_]", lines[0])
    if not re.search("[,;]", text) and not (above and len(lines[-1].split()) > 1):
        lines = lines[1:] if above else lines
        whole = re.fullmatch(r"[\s\d+-]*", " ".join(lines))  # NumPy would also cut 0.5 to 0
        values = np.loadtxt(lines, np.int64 if whole else np.float64, comments=None, ndmin=1)
        # The first of many columns may number the vertices, as in FreeSurfer's text.
        long = values.ndim == 2 and len(values) > values.shape[1]
        if not long or np.ptp(np.sort(values[:, 0]) - np.arange(len(values))):
            return values
    raise SurfaceError(
        f"holds a table or commas ({printable(lines[0][:40])!r}); save the column of a map alone, "
        "in the vertices' order: numpy.savetxt('OUT.txt', table['NAME']), table = "
        "pandas.read_csv(IN, sep=None, engine='python')"
    )


_READERS = {
    ".npy": ("NumPy array", _read_npy),
    ".txt": ("text file of one number a vertex", _read_txt),
    ".gii": ("GIFTI data file", _read_gifti),
    ".mgh": ("MGH file", _read_mgh),
    ".mgz": ("MGH file", _read_mgh),
    ".annot": ("FreeSurfer annotation", lambda _, data: annotations.read(data)),
}
