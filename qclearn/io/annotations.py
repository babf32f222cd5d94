"""FreeSurfer's annotations; nibabel takes names in the table's order and merges equal colours."""

import io
import struct

import nibabel
import numpy as np

from ..surfaces.surface import SurfaceError
from .gifti import NONE, is_nothing
from .safe import FormatError, require_all, sound_text, text_of


def read(data):
    """Keys (V,) of an annotation's bytes, -1 for none; its table, index -> (name, (r, g, b, a))."""
    file = io.BytesIO(data)

    def number():
        return struct.unpack(">i", file.read(4))[0]

    # each vertex with the code of a colour, red + 256 green + 65536 blue
    count = number()
    require_all("vertex", (len(data) - 4) // 8, count)
    vertices, codes = np.frombuffer(file.read(8 * count), ">i4").reshape(-1, 2).T
    if not np.array_equal(np.sort(vertices), np.arange(count)):
        raise FormatError("its vertices are not numbered from 0 on, each once")
    # the table's entries name their index, in any order, or, in the first version, do not
    tag, entries = number(), number()
    indexed = entries == -2
    file.seek(4 * indexed, io.SEEK_CUR)  # one more than the last index
    file.seek(max(number(), 0), io.SEEK_CUR)  # the table's file
    labels, regions = {-1: NONE}, {}  # regions: name -> index, of each colour's code
    for place in range(number() if indexed else entries):
        index, name = number() if indexed else place, text_of(file.read(max(number(), 0)))
        *colour, clear = (number() for _ in range(4))
        if index in labels or index < 0:
            raise FormatError(f"entry {index} of its table is no index, or is there twice")
        labels[index] = name, (*(part / 255 for part in colour), 1 - clear / 255)
        regions.setdefault(int.from_bytes(colour, "little"), {}).setdefault(name, index)
    if tag != 1 or not regions:
        raise FormatError("it has no colour table")
    # black is also the colour of vertices without a region
    black = {name: key for name, key in regions.get(0, {}).items() if not is_nothing(key, labels)}
    regions[0] = black or {NONE[0]: -1}
    # each vertex gets the one region of its colour
    used, places = np.unique(codes[np.argsort(vertices)], return_inverse=True)
    for code in used.tolist():
        if len(regions.get(code, ())) != 1:
            names = " and ".join(map(repr, sorted(regions.get(code, ())))) or "no region"
            raise SurfaceError(f"a vertex has the colour {code}, of {names}; give each its own")
    keys = [key for code in used.tolist() for key in regions[code].values()]
    return np.array(keys, np.int64)[places], labels


def write(path, values, labels):
    """Write keys (V,) as an annotation, in the order of the keys of `labels`; -1, or 0 where it
    shows nothing (Workbench's ???), is none. All that a vertex keeps of its region is the colour:
    where two have the same, or one is black, which would be none, it becomes the next free one."""
    nothing = 0 in labels and labels[0][1][3] == 0 and is_nothing(0, labels)
    keys = sorted(key for key in labels if key > 0 or (key == 0 and not nothing))
    table = {}
    for key in keys:
        *colour, alpha = np.rint(255 * np.clip(labels[key][1], 0, 1)).astype(int).tolist()
        code = int.from_bytes(colour, "big")
        while code in table or code == 0:
            code = (code + 1) % 2**24
        table[code] = [*code.to_bytes(3, "big"), 255 - alpha, 0]
    places = np.where(np.isin(values, keys), np.searchsorted(keys, values), -1)
    names = [sound_text(labels[key][0]) for key in keys]
    nibabel.freesurfer.write_annot(path, places, np.reshape([*table.values()], (-1, 5)), names)
