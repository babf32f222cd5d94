"""PLY through plyfile; OBJ, OFF and STL by short readers of our own.

trimesh and meshio were tried on damaged files: they read half of a cut OBJ, OFF or ASCII STL
without a word, split quadrangles, number vertices anew where a file has normals or textures, or end
the process.

Readers return (vertices, faces), or raise FormatError or what plyfile and NumPy raise on bad bytes;
writers return bytes and keep float64, but for STL.
"""

import io
import re

import numpy as np
import plyfile

from ..surfaces.surface import SurfaceError
from .safe import FormatError, require_all

# Lists of these lengths, which it checks, plyfile reads 100 times faster.
_TRIANGLES = {"face": {"vertex_indices": 3, "vertex_index": 3}}


def read_ply(path, data):
    """Vertices and faces of a PLY file, ASCII or binary; other properties are skipped."""
    header, end, body = data.partition(b"end_header")
    for count in re.findall(rb"element\s+\S+\s+(\d+)", header):
        if int(count) > len(data):  # plyfile would make room for as many
            raise FormatError(f"{int(count)} records are announced in {len(data)} bytes")
    ply = _parse_ply(path, header, end + body)
    elements = {element.name: element for element in ply}
    vertex = elements.get("vertex", ())
    face = elements.get("face", ())
    name = next((name for name in _TRIANGLES["face"] if name in face), None)
    if name is None or not all(axis in vertex for axis in "xyz"):
        raise FormatError(
            "the PLY file lacks vertices with x, y, z, or faces with a list vertex_indices"
        )
    corners = np.asarray(face[name])
    if corners.dtype == object:  # lists of any length
        require_triangles(np.array([len(row) for row in corners]))
        corners = np.array(list(corners))
    if corners.dtype.kind == "f":
        raise FormatError("the corners of the PLY file's faces are no whole numbers")
    vertices = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    return vertices.astype(np.float64), corners.astype(np.int64).reshape(-1, 3)


def _parse_ply(path, header, body):
    """What plyfile reads: of triangles at once, else row by row."""
    if header.isascii():
        try:
            return plyfile.PlyData.read(path, known_list_len=_TRIANGLES)
        except plyfile.PlyElementParseError as error:
            if "unexpected list length" not in str(error):
                raise
    # Comments may hold any letters, which plyfile refuses.
    header = re.sub(rb"[^\0-\x7f]", b"?", header)
    return plyfile.PlyData.read(io.BytesIO(header + body))


def write_ply(surface):
    """Binary PLY with double coordinates."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment qclearn\nelement vertex "
        f"{len(surface.vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(surface.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(surface.faces), dtype=[("sides", "u1"), ("corners", "<i4", (3,))])
    faces["sides"] = 3
    faces["corners"] = surface.faces
    return header.encode() + surface.vertices.astype("<f8").tobytes() + faces.tobytes()


def read_off(data):
    """Vertices and faces of an OFF file; colours and normals are skipped."""
    lines = [line.partition(b"#")[0].split() for line in data.splitlines()]
    rows = [row for row in lines if row]
    if not rows or rows[0][0] not in (b"OFF", b"COFF"):
        raise FormatError("the first word is not OFF")
    rows[0] = rows[0][1:]  # the counts may stand on the first line
    rows = rows if rows[0] else rows[1:]
    if not rows or len(rows[0]) < 2:
        raise FormatError("the OFF header is incomplete")
    n_vertices = int(rows[0][0])
    n_faces = int(rows[0][1])
    if min(n_vertices, n_faces) < 0:
        raise FormatError("the OFF header has a negative count")
    vertex_rows = rows[1 : 1 + n_vertices]
    face_rows = rows[1 + n_vertices : 1 + n_vertices + n_faces]
    require_all("vertex", len(vertex_rows), n_vertices)
    require_all("face", len(face_rows), n_faces)
    require_triangles(np.array([int(row[0]) for row in face_rows]))
    vertices = np.array([row[:3] for row in vertex_rows], dtype=np.float64)
    return vertices, _integers(row[1:4] for row in face_rows)


def _integers(rows):
    """Rows of texts as int64; ValueError or OverflowError where that is impossible."""
    return np.array([[int(text) for text in row] for row in rows], dtype=np.int64)


def write_off(surface):
    """OFF with as many digits as float64 needs."""
    vertices = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in surface.vertices.tolist())
    faces = "".join(f"3 {i} {j} {k}\n" for i, j, k in surface.faces.tolist())
    return f"OFF\n{len(surface.vertices)} {len(surface.faces)} 0\n{vertices}{faces}".encode()


# OBJ has no counts, so a file cut between two lines looks whole: ours carry them in a comment.
_OBJ_COUNTS = "# qclearn: {} vertices, {} faces"


def read_obj(data):
    """Vertices and faces of an OBJ file, Wavefront's or MNI's.

    Texture and normal indices are skipped, negative indices count backwards.
    """
    if data[:1] in (b"P", b"L") or (data[:1] == b"p" and b"\0" in data):
        return _read_mni(data)
    vertices, faces = [], []
    for line in data.splitlines():
        keyword, *texts = line.split() or [b""]
        if keyword == b"v":
            vertices.append([float(text) for text in texts[:3]])
        elif keyword == b"f":
            corners = [int(text.partition(b"/")[0]) for text in texts]
            faces.append([k - 1 if k > 0 else k + len(vertices) for k in corners])
    counts = re.match(re.escape(_OBJ_COUNTS).replace(r"\{\}", r"(\d+)").encode(), data)
    if counts:
        require_all("vertex", len(vertices), int(counts[1]))
        require_all("face", len(faces), int(counts[2]))
    require_triangles(np.array([len(face) for face in faces], dtype=int))
    vertices = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    return vertices, np.array(faces, dtype=np.int64).reshape(-1, 3)


def _read_mni(data):
    """Vertices and faces of MNI's .obj as text, which CIVET writes: P, five numbers of the surface's
    look, the vertices' count, they, their normals, the faces' count, the kind of the colours, these
    (4 numbers each), the place where each face ends among the corners, and the corners."""
    words = data.split()
    if words[0] != b"P":
        message = "is an .obj of MNI, but not one of polygons as text"
        raise SurfaceError(f"{message}; save it so, or convert it to .ply or .gii")
    (n_vertices,) = map(int, words[6:7])
    require_all("vertex", (len(words) - 7) // 6, n_vertices)
    vertices = np.array(words[7 : 7 + 3 * n_vertices], dtype=np.float64).reshape(-1, 3)
    words = words[7 + 6 * n_vertices :]
    n_faces, kind = map(int, words[:2])
    words = words[2 + 4 * {0: 1, 1: n_faces, 2: n_vertices}.get(kind, 0) :]
    require_all("face", len(words), n_faces)
    require_triangles(np.diff(np.array(words[:n_faces], dtype=np.int64), prepend=0))
    require_all("corner", len(words) - n_faces, 3 * n_faces, exactly=True)
    return vertices, np.array(words[n_faces:], dtype=np.int64).reshape(-1, 3)


def write_obj(surface):
    """OBJ with as many digits as float64 needs."""
    counts = _OBJ_COUNTS.format(len(surface.vertices), len(surface.faces))
    vertices = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in surface.vertices.tolist())
    faces = "".join(f"f {i} {j} {k}\n" for i, j, k in (surface.faces + 1).tolist())
    return f"{counts}\n{vertices}{faces}".encode()


_STL_RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data):
    """Vertices and faces of an STL file, ASCII or binary; equal points become one vertex."""
    count = int.from_bytes(data[80:84], "little")
    if data.lstrip().startswith(b"solid") and len(data) != 84 + count * _STL_RECORD.itemsize:
        points = _ascii_stl_points(data)
    elif len(data) < 84:
        raise FormatError("the STL header is incomplete")
    else:
        there = (len(data) - 84) // _STL_RECORD.itemsize
        require_all("face", there, count, exactly=True)
        corners = np.frombuffer(data, _STL_RECORD, count, 84)["corners"]
        points = corners.reshape(-1, 3).astype(np.float64)
    unique, first, corner = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # vertices in the order in which the file names them
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return unique[order], rank[corner.ravel()].reshape(-1, 3)


def _ascii_stl_points(data):
    """The corners (3 F, 3) of an ASCII STL; FormatError where it is cut short."""
    numbers = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)\s", data)
    # no expression for the end: one that looks for it can take hours
    last = data.rstrip().rpartition(b"\n")[2].lstrip()
    facets = len(re.findall(rb"\sendfacet\s", data))
    if not last.startswith(b"endsolid") or len(numbers) != 3 * facets:
        raise FormatError("the ASCII STL file is incomplete")
    return np.array(numbers, dtype=np.float64).reshape(-1, 3)


def write_stl(surface):
    """Binary STL: float32 coordinates, no vertex numbers (a reader numbers them anew)."""
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    records = np.zeros(len(surface.faces), dtype=_STL_RECORD)
    records["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    records["corners"] = corners
    return b"qclearn".ljust(80) + len(records).to_bytes(4, "little") + records.tobytes()


def require_triangles(sides):
    """FormatError, with the first of them, where faces have other than 3 corners; sides: (F,)."""
    bad = np.flatnonzero(sides != 3)
    if bad.size:
        raise FormatError(
            f"face {bad[0]} has {sides[bad[0]]} corners, only triangles are read (triangulate the "
            "mesh)"
        )
