"""PLY, OBJ, OFF and STL: the libraries at hand crash, hang or accept half a mesh where such a file is cut short (VTK's
PLY reader ends the process), and write fewer digits than float64 has.

Readers turn bytes into (vertices, faces), or raise FormatError; writers return bytes and keep float64, but for STL.
"""

import re

import numpy as np

from .safe import FormatError, require_all

_PLY_TYPES = {
    "char": "i1", "short": "i2", "int": "i4", "uchar": "u1", "ushort": "u2", "uint": "u4", "float": "f4",
    "int8": "i1", "int16": "i2", "int32": "i4", "uint8": "u1", "uint16": "u2", "uint32": "u4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip


def read_ply(data):
    """Vertices and faces of a PLY file, ASCII or binary; further scalar properties are skipped."""
    header, end, body = data.partition(b"end_header")
    if not data.startswith(b"ply") or not end:
        raise FormatError("the PLY header is incomplete")
    body = body.partition(b"\n")[2]
    encoding, elements = _ply_header(header.decode("ascii", errors="replace"))
    if len({name for name, _, _ in elements}) < len(elements) or any(count < 0 for _, count, _ in elements):
        raise FormatError("the PLY header names an element twice, or a negative count")
    fields = {name: {field for field, *_ in properties} for name, _, properties in elements}
    if not fields.get("vertex", set()) >= set("xyz") or "corners" not in fields.get("face", ()):
        raise FormatError("the PLY file lacks vertices with x, y, z, or faces with a list vertex_indices")
    if encoding == "ascii":
        rows = [line.split() for line in body.splitlines() if line.strip()]
    tables = {}
    for name, count, properties in elements:
        if encoding == "ascii":
            tables[name], rows = _ply_ascii_table(name, count, properties, rows)
        else:
            tables[name], body = _ply_binary_table(name, count, properties, body, encoding)
        if {"vertex", "face"} <= tables.keys():  # what follows is not needed
            break
    vertices = np.stack([tables["vertex"][axis] for axis in "xyz"], axis=1)
    return vertices.astype(np.float64), tables["face"]["corners"].astype(np.int64)


def _ply_header(header):
    """The encoding and [(element, count, [(property, type[, shape])])]; a face's index list becomes two fields."""
    encoding, elements = None, []
    for line in header.splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            encoding = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(words[1])
        elif words[:1] == ["element"] and len(words) == 3:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            if not elements:
                raise FormatError("the PLY header has a property before any element")
            elements[-1][2].extend(_ply_property(words))
    if encoding is None or not all(properties for _, _, properties in elements):
        raise FormatError("the PLY header names no known encoding, or an element without properties")
    return encoding, elements


def _ply_property(words):
    """The fields [(name, type[, shape])] of one line: `property TYPE NAME`, or the list of a face's corners."""
    listed = words[1:2] == ["list"]
    kinds, name = words[2 if listed else 1 : -1], words[-1]
    if len(kinds) != 1 + listed or not all(kind in _PLY_TYPES for kind in kinds):
        raise FormatError(f"the PLY header has a property that is not understood: {' '.join(words)[:60]!r}")
    kinds = [_PLY_TYPES[kind] for kind in kinds]
    if not listed:
        return [(name, kinds[0])]
    if name not in ("vertex_indices", "vertex_index"):
        raise FormatError(f"the PLY file has a list {name[:40]!r}, which is not read here")
    if "f" in "".join(kinds):
        raise FormatError("the corners of the PLY file's faces are no whole numbers")
    return [("sides", kinds[0]), ("corners", kinds[1], (3,))]


def _ply_binary_table(name, count, properties, body, order):
    dtype = np.dtype([(field, order + kind, *shape) for field, kind, *shape in properties])
    table = np.frombuffer(body, dtype=dtype, count=min(count, len(body) // dtype.itemsize))
    if "sides" in dtype.names:  # before the length: records of polygons have another one
        require_triangles(table["sides"])
    require_all(name, len(table), count)
    return table, body[count * dtype.itemsize :]


def _ply_ascii_table(name, count, properties, rows):
    dtype = np.dtype([(field, kind, *shape) for field, kind, *shape in properties])
    if "sides" in dtype.names:
        column = next(k for k, (field, *_) in enumerate(properties) if field == "sides")
        require_triangles(_integers([row[column : column + 1] for row in rows[:count]]).ravel())
    require_all(name, len(rows[:count]), count)
    values = np.array(rows[:count], dtype=np.float64).reshape(count, -1)
    table, column = np.empty(count, dtype=dtype), 0
    width = sum(3 if shape else 1 for _, _, *shape in properties)
    if count and values.shape[1] != width:
        raise FormatError(f"the PLY {name} rows have {values.shape[1]} numbers where the header says {width}")
    for field, kind, *shape in properties:
        part = values[:, column : column + 3] if shape else values[:, column]
        if "f" not in kind and not _fits(part, kind):
            raise FormatError(f"the PLY {name}'s {field!r} is no whole number of its type somewhere")
        table[field] = part
        column += 3 if shape else 1
    return table, rows[count:]


def _fits(values, kind):
    limits = np.iinfo(kind)
    return bool(((values == np.floor(values)) & (values >= limits.min) & (values <= limits.max)).all())


def _integers(rows):
    """Rows of words as int64; ValueError where a word is no whole number, OverflowError for one beyond 64 bits."""
    return np.array([[int(word) for word in row] for row in rows], dtype=np.int64)


def write_ply(surface):
    """Binary PLY with double coordinates."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment qclearn\n"
        f"element vertex {len(surface.vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(surface.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(surface.faces), dtype=[("sides", "u1"), ("corners", "<i4", (3,))])
    faces["sides"], faces["corners"] = 3, surface.faces
    return header.encode() + surface.vertices.astype("<f8").tobytes() + faces.tobytes()


def read_off(data):
    """Vertices and faces of an OFF file; colours and normals that follow the numbers of a row are skipped."""
    lines = [line.partition(b"#")[0].split() for line in data.splitlines()]
    rows = [words for words in lines if words]
    if not rows or rows[0][0] not in (b"OFF", b"COFF"):
        raise FormatError("the first word is not OFF")
    rows[0] = rows[0][1:]  # the counts may stand on the first line
    rows = rows if rows[0] else rows[1:]
    if not rows or len(rows[0]) < 2:
        raise FormatError("the OFF header is incomplete")
    n_vertices, n_faces = int(rows[0][0]), int(rows[0][1])
    if min(n_vertices, n_faces) < 0:
        raise FormatError("the OFF header has a negative count")
    vertex_rows, face_rows = rows[1 : 1 + n_vertices], rows[1 + n_vertices : 1 + n_vertices + n_faces]
    require_all("vertex", len(vertex_rows), n_vertices)
    require_all("face", len(face_rows), n_faces)
    require_triangles(np.array([int(words[0]) for words in face_rows]))
    vertices = np.array([words[:3] for words in vertex_rows], dtype=np.float64)
    return vertices, _integers(words[1:4] for words in face_rows)


def write_off(surface):
    """OFF with as many digits as float64 needs."""
    vertices = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in surface.vertices.tolist())
    faces = "".join(f"3 {i} {j} {k}\n" for i, j, k in surface.faces.tolist())
    return f"OFF\n{len(surface.vertices)} {len(surface.faces)} 0\n{vertices}{faces}".encode()


# OBJ has no counts, so a file cut between two lines looks whole: ours carry them in a comment.
_OBJ_COUNTS = "# qclearn: {} vertices, {} faces"


def read_obj(data):
    """Vertices and faces of an OBJ file; texture and normal indices are skipped, negative indices count backwards."""
    vertices, corners, sides = [], [], []
    for line in data.splitlines():
        words = line.split()
        if words[:1] == [b"v"]:
            vertices.append([float(word) for word in words[1:4]])
        elif words[:1] == [b"f"]:
            face = [int(word.partition(b"/")[0]) for word in words[1:]]
            sides.append(len(face))
            corners.append([index - 1 if index > 0 else index + len(vertices) for index in face])
    counts = re.match(re.escape(_OBJ_COUNTS).replace(r"\{\}", r"(\d+)").encode(), data)
    if counts:
        require_all("vertex", len(vertices), int(counts[1]))
        require_all("face", len(corners), int(counts[2]))
    require_triangles(np.array(sides, dtype=int))
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), np.array(corners, dtype=np.int64).reshape(-1, 3)


def write_obj(surface):
    """OBJ with as many digits as float64 needs."""
    counts = _OBJ_COUNTS.format(len(surface.vertices), len(surface.faces))
    vertices = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in surface.vertices.tolist())
    faces = "".join(f"f {i} {j} {k}\n" for i, j, k in (surface.faces + 1).tolist())
    return f"{counts}\n{vertices}{faces}".encode()


_STL_RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data):
    """Vertices and faces of an STL file, ASCII or binary; points with equal coordinates become one vertex."""
    count = int.from_bytes(data[80:84], "little")
    if data.lstrip().startswith(b"solid") and len(data) != 84 + count * _STL_RECORD.itemsize:
        numbers = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)\s", data)
        last = data.rstrip().rpartition(b"\n")[2].lstrip()  # no expression: those that look for an end can take hours
        if not last.startswith(b"endsolid") or len(numbers) != 3 * len(re.findall(rb"\sendfacet\s", data)):
            raise FormatError("the ASCII STL file is incomplete")
        points = np.array(numbers, dtype=np.float64).reshape(-1, 3)
    else:
        if len(data) < 84:
            raise FormatError("the STL header is incomplete")
        require_all("face", (len(data) - 84) // _STL_RECORD.itemsize, count, exactly=True)
        points = np.frombuffer(data, _STL_RECORD, count, 84)["corners"].reshape(-1, 3).astype(np.float64)
    unique, first, corner = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # vertices in the order in which the file names them
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return unique[order], rank[corner.ravel()].reshape(-1, 3)


def write_stl(surface):
    """Binary STL: float32 coordinates, no vertex numbers (a reader numbers them anew)."""
    records = np.zeros(len(surface.faces), dtype=_STL_RECORD)
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    records["corners"] = corners
    return b"qclearn".ljust(80) + len(records).to_bytes(4, "little") + records.tobytes()


def require_triangles(sides):
    bad = np.flatnonzero(sides != 3)
    if bad.size:
        raise FormatError(f"face {bad[0]} has {sides[bad[0]]} corners, only triangles are read (triangulate the mesh)")
