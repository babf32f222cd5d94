"""FreeSurfer's annotations: regions with names and colours; the colour is what a vertex keeps.

nibabel takes names in the order of the table, not by their index, and merges regions of one colour.
"""

import io
import struct

import nibabel
import numpy as np

from ..surfaces.surface import SurfaceError
from .gifti import NONE, is_nothing
from .safe import FormatError, require_all, sound_text, text_of


def read(data):
    """Keys (V,), the indices of FreeSurfer's table, -1 for none; and their table, key -> (name,
    (r, g, b, a) from 0 to 1), from an annotation's bytes."""
    file = io.BytesIO(data)

    def number():
        return struct.unpack(">i", file.read(4))[0]

    def text():
        return text_of(file.read(max(number(), 0)))

    # each vertex with the code of a colour, red + 256 green + 65536 blue
    count = number()
    require_all("vertex", (len(data) - 4) // 8, count)
    vertices, codes = np.frombuffer(file.read(8 * count), ">i4").reshape(-1, 2).T
    if not np.array_equal(np.sort(vertices), np.arange(count)):
        raise FormatError("its vertices are not numbered from 0 on, each once")
    # the table's entries name their index, in any order, or, in the first version, do not
    tag, entries = number(), number()
    indexed = entries == -2
    if indexed:
        number()  # one more than the last index
    text()  # the table's file
    labels, indices = {-1: NONE}, {}  # indices: of each colour
    for place in range(number() if indexed else entries):
        index, name, colour = number() if indexed else place, text(), [number() for _ in range(4)]
        if index in labels or index < 0:
            raise FormatError(f"entry {index} of its table is no index, or is there twice")
        labels[index] = name, (*(part / 255 for part in colour[:3]), 1 - colour[3] / 255)
        indices.setdefault(int.from_bytes(bytes(colour[:3]), "little"), []).append(index)
    if tag != 1 or not indices:
        raise FormatError("it has no colour table")
    # black is also the colour of vertices without a region
    indices[0] = [index for index in indices.get(0, ()) if not is_nothing(index, labels)] or [-1]
    # each vertex gets the one region of its colour
    used, places = np.unique(codes, return_inverse=True)
    for code in used.tolist():
        names = sorted({labels[index][0] for index in indices.get(code, ())})
        if not names:
            raise FormatError(f"the colour {code} of a vertex is that of none of its regions")
        if len(names) > 1:
            raise SurfaceError(
                f"its regions {' and '.join(map(repr, names))} have one colour, "
                f"{list(code.to_bytes(3, 'little'))}, by which alone a vertex names its region; "
                "give each its own, and make the annotation again"
            )
    keys = np.empty(count, dtype=np.int64)
    keys[vertices] = np.array([indices[code][0] for code in used.tolist()])[places]
    return keys, labels


def write(path, values, labels):
    """Write keys (V,) as an annotation, in the order of the keys of `labels`.

    Key -1, or key 0 where it is shown by nothing (Workbench's ???), is none. Colours are made
    distinct where two regions have the same, since a vertex keeps its region's colour alone; black
    would be none.
    """
    nothing = 0 in labels and labels[0][1][3] == 0 and is_nothing(0, labels)
    keys = sorted(key for key in labels if key > 0 or (key == 0 and not nothing))
    table, seen = [], {(0, 0, 0)}
    for key in keys:
        red, green, blue, alpha = np.rint(np.multiply(labels[key][1], 255)).astype(int).tolist()
        while (red, green, blue) in seen:
            blue = (blue + 1) % 256
            green = (green + (blue == 0)) % 256
        seen.add((red, green, blue))
        table.append([red, green, blue, 255 - alpha, 0])
    places = np.where(np.isin(values, keys), np.searchsorted(keys, values), -1)
    names = [sound_text(labels[key][0]) for key in keys]
    table = np.array(table).reshape(-1, 5)
    nibabel.freesurfer.write_annot(path, places, table, names, fill_ctab=True)
