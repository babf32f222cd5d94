"""GIFTI through nibabel, in which Workbench finds hemisphere, kind and labels."""

import base64
import colorsys
import gzip
import io
import re
import warnings
import zlib

import nibabel
import numpy as np
from nibabel import gifti as nib
from nibabel.gifti import GiftiCoordSystem, GiftiImage, GiftiMetaData
from nibabel.gifti.parse_gifti_fast import GiftiImageParser

from ..surfaces.surface import SurfaceError
from .frames import ANATOMICAL, SHAPES, TKR, Frame, agreed_side, in_ras, kind_of_name, sound_volume
from .safe import FormatError, LeftOutWarning, sound_text

STRUCTURES = {"left": "CortexLeft", "right": "CortexRight"}
# FreeSurfer's volume geometry: its own names -> the endings of those that mris_convert writes into
# a GIFTI.
_VOLUME = {
    "volume": ("Width", "Height", "Depth"), "voxelsize": ("Xsize", "Ysize", "Zsize"),
    **{f"{axis}ras": tuple(f"{axis.upper()}_{letter}" for letter in "RAS") for axis in "xyzc"},
}  # fmt: skip
# Of a disk, what an npz has as arrays: the numbers of its vertices in the whole surface as runs of
# ones, packed, and the count of that surface's vertices.
_TABLE = "QclearnOriginalVertices"
_COUNT = "QclearnWholeVertices"
_NODE_INDEX = nibabel.nifti1.intent_codes["NIFTI_INTENT_NODE_INDEX"]
_LABEL = nibabel.nifti1.intent_codes["NIFTI_INTENT_LABEL"]
_MOST_LABELS = 4096  # whole numbers of more values than that are no regions

# Key -1 is no region; FreeSurfer and Workbench show it so.
NONE = ("???", (1.0, 1.0, 1.0, 0.0))
# Names of what is no region.
_NOTHING = re.compile(
    r"(?i)|(.*[-+_. ])?(\?\?\?|none|unknown|unassigned|unlabell?ed|background|medial[-_. ]?wall)"
)


def is_nothing(key, labels):
    """Whether a key of a label table is no region: by its name, or shown by nothing among others
    that are shown."""
    name, colour = labels[key]
    shown = any(colour[3] for _, colour in labels.values())
    return _NOTHING.fullmatch(name) is not None or (shown and colour[3] == 0)


class _Parser(GiftiImageParser):
    """nibabel's, with the coordinate systems of any writer: one that cannot be read has none."""

    def flush_chardata(self):
        text = "".join(self._char_blocks or ())
        if self.write_to == "MatrixData" and self._char_blocks:  # 16 numbers in any lines
            self._char_blocks = [" ".join("".join(self._char_blocks).split())]
        try:
            super().flush_chardata()
        except (KeyError, ValueError):
            if self.write_to not in ("DataSpace", "TransformedSpace", "MatrixData"):
                raise
            self.coordsys.dataspace = None
            self.img.meta["UnknownSpace"] = text


def parse(path, data):
    """The nibabel image of a GIFTI file's bytes; data of their own (SPM, CAT12) stand beside it."""
    reader, source = _Parser(mmap=False), io.BytesIO(data)
    source.name = str(path)
    reader.parse(fptr=source)
    if any(array.data is None for array in reader.img.darrays):
        raise FormatError("an array has no data")
    return reader.img


def side_of_image(image):
    """The hemisphere that an image's metadata name, or None; SurfaceError where they name both."""
    metas = [image.meta, *(array.meta for array in image.darrays)]
    named = {meta.get("AnatomicalStructurePrimary") for meta in metas}
    sides = [side for side, structure in STRUCTURES.items() if structure in named]
    if len(sides) > 1:
        command = "wb_command -set-structure FILE CORTEX_LEFT, or CORTEX_RIGHT"
        raise SurfaceError(f"its metadata name both hemispheres; correct them: {command}")
    return sides[0] if sides else None


def surface_arrays(path, data):
    """Points, in RAS, and triangles of a surface's file."""
    image = parse(path, data)
    points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = image.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if len(points) != 1 or len(triangles) != 1:
        advice = "give a .surf.gii with one point set and its triangles"
        raise SurfaceError(f"is GIFTI, but not one surface; {advice}")
    header = "\n".join(f"{a}={b}" for a, b in {**image.meta, **points[0].meta}.items())
    header += "\nspace=LPS" if turns(points[0].coordsys) else ""
    vertices, table = in_ras(path, points[0].data, header), points[0].meta.get(_TABLE)
    if table is not None:  # the numbers of a disk's vertices in the whole surface
        runs = np.frombuffer(zlib.decompress(base64.b64decode(table)), "u1")
        if len(runs) != 4 * len(vertices):
            raise FormatError(f"{_TABLE} does not hold the numbers of {len(vertices)} vertices")
        table = runs.view("<i4").astype(np.int64).cumsum()
    return vertices, triangles[0].data, {}, table


def turns(own):
    """Whether a coordinate system's matrix turns x and y round into a known space: all are RAS."""
    known = own and own.dataspace is not None and own.xformspace and np.size(own.xform) == 16
    return known and np.array_equal(np.reshape(own.xform, (4, 4))[:3, :3], np.diag([-1, -1, 1]))


def maps_of(image):
    """The arrays of a map's image that are no NODE_INDEX."""
    return [array for array in image.darrays if array.intent != _NODE_INDEX]


def values_of(image):
    """Values (V,) or, of several arrays, (V, k) of a map's image, in the order of the vertices; and
    which of the k hold whole numbers where some do and others do not, else None."""
    labels = labels_of(image)
    named = any(key not in (-1, 0) or not is_nothing(key, labels) for key in labels)
    arrays = [_as_labels(array, named) for array in maps_of(image)]
    meshes = map(image.get_arrays_from_intent, ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"))
    if any(meshes) or not arrays or len({array.shape for array in arrays}) > 1:
        advice = "give a .func.gii, .shape.gii or .label.gii"
        raise SurfaceError(f"holds no maps of one value a vertex; {advice}")
    integer = [array.dtype.kind != "f" for array in arrays]
    values = arrays[0] if len(arrays) == 1 else np.stack(arrays, axis=-1)
    for array in image.get_arrays_from_intent(_NODE_INDEX):
        index = np.ravel(array.data)
        if not np.array_equal(np.sort(index), np.arange(len(values))):
            raise SurfaceError(
                f"gives {len(values)} values to {len(np.unique(index))} vertices from {index.min()} "
                f"to {index.max()} (NODE_INDEX), not one to each from 0 on; fill the others in: "
                "ConvertDset -o_gii -pad_to_node LAST -input IN -prefix OUT"
            )
        values = values[np.argsort(index)]
    return values, integer if len(set(integer)) > 1 else None


def _as_labels(array, named):
    """An array's data, without sides of 1; labels (by the intent, or whole numbers with a table
    that names regions) as integers where they are stored as floats."""
    data = np.atleast_1d(np.squeeze(array.data))
    if data.dtype.kind != "f":
        return data
    odd = data % 1 != 0  # also NaN and infinite
    if array.intent != _LABEL and not (named and not odd[np.isfinite(data)].any()):
        return data
    if odd.any():
        value, vertex = data[odd][0], np.argwhere(odd)[0][0]
        message = f"holds labels, but {value} at vertex {vertex}, no whole number"
        raise SurfaceError(f"{message}, as at {odd.sum()} places; give 0 to what is none")
    return data.astype(np.int32)


def labels_of(image):
    """The label table: dict key -> (name, (red, green, blue, alpha) from 0 to 1)."""
    return {
        label.key: (
            getattr(label, "label", None) or "",
            tuple(1.0 if part is None else part for part in label.rgba),
        )
        for label in image.labeltable.labels
    }


def frame_of_image(path, image):
    """The Frame of a surface's or a map's image: what its metadata say, else its name."""
    points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    meta = {**image.meta, **(points[0].meta if points else {})}
    secondary = meta.get("AnatomicalStructureSecondary")
    shape = meta.get("GeometricType")
    shape = "Spherical" if shape == "Sphere" else shape  # FreeSurfer's word
    layer = secondary if secondary in ANATOMICAL else kind_of_name(path)
    kind = shape if shape in SHAPES else layer
    side = agreed_side(path, side_of_image(image))
    if not points:
        return Frame(side)
    count = int(meta[_COUNT]) if re.fullmatch("[1-9][0-9]{0,9}", meta.get(_COUNT, "")) else None
    # A coordinate system counts with a known name and a 4 x 4 matrix.
    given, space = points[0].coordsys, None
    if given and given.dataspace is not None and np.size(given.xform) == 16:
        xform = np.reshape(given.xform, (4, 4))
        xform = xform @ np.diag([-1, -1, 1, 1]) if turns(given) else xform
        space = GiftiCoordSystem(given.dataspace, given.xformspace, xform)
    elif given:
        fault = "its coordinate system has an unknown name or not 4 x 4 numbers, and is left out"
        warnings.warn(f"{path}: {fault}", LeftOutWarning, stacklevel=2)
    return Frame(side, space, _volume_of(meta), kind, count)


def _volume_of(meta):
    """FreeSurfer's volume geometry in a point set's metadata, or None."""
    try:
        geometry = {
            k: [float(meta[f"VolGeom{end}"]) for end in ends] for k, ends in _VOLUME.items()
        }
    except (KeyError, ValueError):  # none, or a part, as fMRIPrep leaves it
        return None
    named = {"valid": "1  # volume info valid", "filename": meta.get("VolGeomFname", "")}
    geometry["volume"] = [int(size) for size in geometry["volume"]]
    return sound_volume({"head": [2, 0, 20], **named, **geometry})


def surface_bytes(surface, frame, table):
    """The bytes of a .surf.gii; FreeSurfer's coordinates become the scanner's, as mris_convert
    --to-scanner does, but for spheres and the like, which lie nowhere and stay around their
    centre. table (V,): the original numbers."""
    meta = _structure(frame.side)
    vertices = surface.vertices
    space = frame.space
    if frame.space == TKR:
        anatomical = frame.kind not in SHAPES
        vertices = frame.to_scanner(vertices) if anatomical else vertices
        space = GiftiCoordSystem(1, 1) if anatomical else None  # 1: NIFTI_XFORM_SCANNER_ANAT
    # Workbench's terms for a kind; an inflated surface needs a second one, and gets HCP's
    own, kind = dict(meta), frame.kind
    if kind:
        own["GeometricType"] = "Anatomical" if kind in ANATOMICAL else kind
    if kind not in (None, "Spherical"):
        own["AnatomicalStructureSecondary"] = kind if kind in ANATOMICAL else "MidThickness"
    if frame.volume:
        for key, ends in _VOLUME.items():
            own |= {f"VolGeom{end}": f"{x:.10g}" for end, x in zip(ends, frame.volume[key])}
        own["VolGeomFname"] = frame.volume["filename"]
    if table is not None:
        runs = np.diff(table, prepend=0).astype("<i4")
        own[_TABLE] = base64.b64encode(zlib.compress(runs.tobytes())).decode()
    own |= {_COUNT: str(frame.count)} if frame.count else {}
    space = space or GiftiCoordSystem()
    points = _array(vertices.astype(np.float32), "NIFTI_INTENT_POINTSET", own, coordsys=space)
    triangles = _array(surface.faces.astype(np.int32), "NIFTI_INTENT_TRIANGLE", {})
    return GiftiImage(meta=GiftiMetaData(meta), darrays=[points, triangles]).to_bytes()


def _structure(side):
    return {"AnatomicalStructurePrimary": STRUCTURES[side]} if side else {}


def _array(data, intent, meta, **more):
    data = np.ascontiguousarray(data)
    meta = GiftiMetaData({name: sound_text(text) for name, text in meta.items()})
    return nib.GiftiDataArray(data, intent=intent, meta=meta, **more)


def values_bytes(columns, side, labels, names):
    """The bytes of named maps, k of (V,), float32 or int32; int32 with `labels` are labels."""
    meta = GiftiMetaData(_structure(side))
    table = nib.GiftiLabelTable()
    of_integers = "NIFTI_INTENT_NONE"
    if labels:
        raised, entries = _from_zero(labels)
        columns = [raised(column) if column.dtype.kind == "i" else column for column in columns]
        of_integers = "NIFTI_INTENT_LABEL"
        for key, (name, colour) in sorted(entries.items()):
            table.labels.append(nib.GiftiLabel(key, *colour))
            table.labels[-1].label = sound_text(name)
    named = [{"Name": name} for name in names] if names else [{}] * len(columns)
    intents = {"f": "NIFTI_INTENT_SHAPE", "i": of_integers}
    arrays = [_array(one, intents[one.dtype.kind], own) for one, own in zip(columns, named)]
    return GiftiImage(meta=meta, labeltable=table, darrays=arrays).to_bytes()


def table_of(values, known):
    """The label table of whole numbers, unknown keys named by their number; {} for too many."""
    keys = np.unique(values).tolist()
    if not known and (len(keys) > _MOST_LABELS or keys[0] < -1):
        return {}
    hues = [k * 0.618 % 1 for k in range(len(keys))]
    colours = [(*colorsys.hsv_to_rgb(hue, 0.6, 0.9), 1.0) for hue in hues]
    table = {key: (str(key), colour) for key, colour in zip(keys, colours)}
    return table | {key: NONE for key in keys if key in (-1, 0)} | (known or {})


def _from_zero(table):
    """What takes keys to those of a table without key -1, which becomes 0, and that table; where 0
    is a region, all are raised by one."""
    if min(table) < -1:
        message = "keys below 0 are not allowed in a .label.gii"
        raise SurfaceError(f"label {min(table)}: {message}; number them from 1")
    if min(table) >= 0:
        return lambda keys: keys, table
    if 0 not in table or is_nothing(0, table):
        name, colour = table.get(0, NONE)
        regions = {key: entry for key, entry in table.items() if key > 0}
        return lambda keys: np.maximum(keys, 0), {0: (name, (*colour[:3], 0.0)), **regions}
    return lambda keys: keys + 1, {key + 1: entry for key, entry in table.items()}


def names_of(path, values):
    """Names of the maps (V,) or (V, k) of a file after that of the file."""
    name = re.sub(r"(\.(shape|func|label))?\.gii(\.gz|\.dset)?$", "", path.name)
    return [name] if values.ndim == 1 else [f"{name} {k + 1}" for k in range(values.shape[1])]


def zipped(path, data):
    """The bytes as the path's suffix wants them."""
    return gzip.compress(data, mtime=0) if path.suffix.lower() in (".gz", ".mgz") else data
