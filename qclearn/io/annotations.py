"""FreeSurfer's annotations: regions with names and colours; the colour is what a vertex keeps."""

import nibabel
import numpy as np

from .safe import FormatError, require_all, sound_text, text_of

# Key -1 is no region; FreeSurfer and Workbench show it so.
NONE = ("???", (1.0, 1.0, 1.0, 0.0))


def parts(path, data):
    """Places in the table (V,), -1 for none; the table (N, 5); the names."""
    integers = np.frombuffer(data[: len(data) // 4 * 4], ">i4")
    n_vertices = int(integers[0]) if len(integers) else -1
    require_all("vertex", (len(integers) - 1) // 2, n_vertices)
    head = integers[2 * n_vertices + 1 :][:3].tolist()
    if len(head) < 3 or head[0] != 1 or head[1] != -2 or not 0 <= head[2] <= len(data):
        raise FormatError("it has no colour table of FreeSurfer's second version")
    if not np.array_equal(np.sort(integers[1 : 2 * n_vertices : 2]), np.arange(n_vertices)):
        raise FormatError("its vertices are not numbered from 0 on, each once")
    colours, table, names = nibabel.freesurfer.read_annot(path, orig_ids=True)
    given = colours != 0
    missing = np.count_nonzero(given & ~np.isin(colours, table[:, 4]))
    if missing or not 0 < len(table) == len(names):
        raise FormatError(
            f"{missing} vertices have a colour that is not in its table of {len(names)} names"
        )
    order = np.argsort(table[:, 4], kind="stable")
    labels = np.full(n_vertices, -1)
    place = order[np.searchsorted(table[order, 4], colours[given])]
    labels[integers[1 : 2 * n_vertices : 2][given]] = place
    return labels, table, names


def labels_of(table, names):
    """Key -> (name, (r, g, b, a) from 0 to 1) of an annotation's table, and -1 for none."""
    colours = np.column_stack([table[:, :3], 255 - table[:, 3]]) / 255
    names = map(text_of, names)
    return {-1: NONE} | {
        key: (name, tuple(colours[key].tolist())) for key, name in enumerate(names)
    }


def write(path, values, labels):
    """Write keys (V,) as an annotation, in the order of the keys of `labels`.

    Key -1, or key 0 where it is shown by nothing (Workbench's ???), is none. Colours are made
    distinct where two regions have the same, since a vertex keeps its region's colour alone; black
    would be none.
    """
    none = {key for key, (_, colour) in labels.items() if key < 0 or (key == 0 and colour[3] == 0)}
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
