"""FreeSurfer's annotations: regions with names and colours; the colour is what a vertex keeps."""

import io
import re
import struct

import nibabel
import numpy as np

from ..surfaces.surface import SurfaceError
from .safe import FormatError, require_all, sound_text, text_of

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


def nothing_key(labels):
    """The key of no region in a label table: one that is there, else one that it does not use."""
    there = [key for key in (-1, 0) if key in labels and is_nothing(key, labels)]
    free = [key for key in (0, -1, max(labels) + 1) if key not in labels]
    return (there + free)[0]


def read(data):
    """Keys (V,), the indices of FreeSurfer's table, -1 for none; and their table, key -> (name,
    (r, g, b, a) from 0 to 1), from an annotation's bytes."""
    integers = np.frombuffer(data[: len(data) // 4 * 4], ">i4")
    n_vertices = int(integers[0]) if len(integers) else -1
    require_all("vertex", (len(integers) - 1) // 2, n_vertices)
    vertices, colours = integers[1 : 2 * n_vertices + 1].reshape(-1, 2).T
    if not np.array_equal(np.sort(vertices), np.arange(n_vertices)):
        raise FormatError("its vertices are not numbered from 0 on, each once")
    labels = {}
    indices = {}  # of each colour
    for index, name, colour in _entries(io.BytesIO(data[4 + 8 * n_vertices :])):
        red, green, blue, transparency = colour
        if index in labels or index < 0:
            raise FormatError(f"entry {index} of its table is no index, or is there twice")
        labels[index] = name, tuple(part / 255 for part in (red, green, blue, 255 - transparency))
        indices.setdefault(int.from_bytes(bytes([red, green, blue]), "little"), []).append(index)
    # black is also the colour of vertices without a region
    black = [index for index in indices.get(0, ()) if not _NOTHING.fullmatch(labels[index][0])]
    indices[0] = black or [-1]
    used, places = np.unique(colours, return_inverse=True)
    missing = np.count_nonzero(~np.isin(colours, list(indices)))
    if missing or not labels:
        raise FormatError(
            f"{missing} vertices have a colour that is not in its table of {len(labels)} names"
        )
    for code in used.tolist():
        names = sorted({labels[index][0] for index in indices[code] if index >= 0})
        if len(names) > 1:
            raise SurfaceError(
                f"its regions {names[0]!r} and {names[1]!r} have one colour, "
                f"{list(code.to_bytes(3, 'little'))}, by which alone a vertex names its region; "
                "give each its own, and make the annotation again"
            )
    keys = np.empty(n_vertices, dtype=np.int64)
    keys[vertices] = np.array([indices[code][0] for code in used.tolist()])[places.ravel()]
    return keys, {-1: NONE} | labels


def _entries(file):
    """Index, name and [red, green, blue, transparency] of each entry of a colour table, which
    stand in any order and may leave indices out; the first version has no indices."""

    def number():
        return struct.unpack(">i", file.read(4))[0]

    def text():
        return text_of(file.read(max(number(), 0)))

    tag, count = number(), number()
    if tag != 1 or (count <= 0 and count != -2):
        raise FormatError("it has no colour table")
    indexed = count == -2
    if indexed:
        number()  # one more than the last index
    text()  # the table's file
    count = number() if indexed else count
    for place in range(count):
        yield number() if indexed else place, text(), [number() for _ in range(4)]


def write(path, values, labels):
    """Write keys (V,) as an annotation, in the order of the keys of `labels`.

    Key -1, or key 0 where it is shown by nothing (Workbench's ???), is none. Colours are made
    distinct where two regions have the same, since a vertex keeps its region's colour alone; black
    would be none.
    """
    none = {key for key, (_, colour) in labels.items() if key < 0 or (key == 0 and colour[3] == 0)}
    none -= {0} if 0 in none and not is_nothing(0, labels) else set()
    keys = np.array(sorted(set(labels) - none))
    table = np.zeros((len(keys), 5), dtype=np.int64)
    seen = {(0, 0, 0)}
    for row, key in zip(table, keys.tolist()):
        red, green, blue, alpha = np.rint(np.multiply(labels[key][1], 255)).astype(int).tolist()
        while (red, green, blue) in seen:
            blue = (blue + 1) % 256
            green = (green + (blue == 0)) % 256
        seen.add((red, green, blue))
        row[:4] = red, green, blue, 255 - alpha
    places = np.where(np.isin(values, list(none)), -1, np.searchsorted(keys, values))
    names = [sound_text(labels[key][0]) for key in keys.tolist()]
    nibabel.freesurfer.write_annot(path, places, table, names, fill_ctab=True)
