"""PLY through plyfile; Wavefront's OBJ by a short reader of our own.

trimesh and meshio were tried on damaged files: they read half of a cut OBJ without a word, split
quadrangles, and number vertices anew where a file has normals or textures.

Readers return (vertices, faces), or raise FormatError or what plyfile and NumPy raise on bad bytes;
writers return bytes and keep float64.
"""

import io
import re

import numpy as np
import plyfile

from ..moved import gone
from ..surfaces.surface import SurfaceError
from .frames import in_ras
from .safe import FormatError, require_all, text_of

# Lists of these lengths, which it checks, plyfile reads 100 times faster.
_TRIANGLES = {"face": {"vertex_indices": 3, "vertex_index": 3}}


def read_ply(path, data):
    """Vertices and faces of a PLY file, ASCII or binary; other properties are skipped."""
    header, end, body = data.partition(b"end_header")
    # comments may hold any letters, which plyfile refuses
    data = re.sub(rb"[^\0-\x7f]", b"?", header) + end + body
    try:
        ply = plyfile.PlyData.read(io.BytesIO(data), known_list_len=_TRIANGLES)
    except plyfile.PlyElementParseError as error:
        if "unexpected list length" not in str(error):
            raise
        ply = plyfile.PlyData.read(io.BytesIO(data))  # row by row, so that the face can be named
    elements = {element.name: element for element in ply}
    vertex = elements.get("vertex", ())
    face = elements.get("face", ())
    name = next((name for name in _TRIANGLES["face"] if name in face), None)
    if name is None or not all(axis in vertex for axis in "xyz"):
        raise FormatError("it lacks vertices with x, y, z, or faces with a list vertex_indices")
    corners = np.asarray(face[name])
    if corners.dtype == object:  # lists of any length
        require_triangles([len(row) for row in corners])
        corners = np.stack(corners)
    if corners.dtype.kind == "f":
        raise FormatError("the corners of the PLY file's faces are no whole numbers")
    vertices = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    vertices = in_ras(path, vertices.astype(np.float64), header.decode("latin-1"))
    return vertices, corners.astype(np.int64).reshape(-1, 3)


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


# OBJ has no counts, so a file cut between two lines looks whole: ours carry them in a comment.
_OBJ_COUNTS = "# qclearn: {} vertices, {} faces"


def read_obj(path, data):
    """Vertices and faces of a Wavefront OBJ file.

    Texture and normal indices are skipped, negative indices count backwards.
    """
    if data[:1] == b"P":
        raise SurfaceError(gone("MNI's .obj"))
    vertices, faces = [], []
    whole = b"\n".join(re.sub(rb"(^|\s)#.*", b"", line) for line in data.splitlines())
    whole = re.sub(rb"\\\s*\n", b" ", whole)  # a line goes on behind \
    for keyword, *texts in filter(None, map(bytes.split, whole.splitlines())):
        if keyword == b"v" and len(texts) > 2:
            vertices.append([float(text) for text in texts[:3]])
        elif keyword == b"f":
            corners = [int(text.partition(b"/")[0]) for text in texts]
            faces.append([k - 1 if k > 0 else k + len(vertices) for k in corners])
        elif keyword == b"v" or not re.fullmatch(rb"[a-z][a-z_0-9]*", keyword):
            # left out, it would shift the numbers of the vertices behind it
            raise FormatError(f"no OBJ has a line {text_of(b' '.join([keyword, *texts]))[:40]!r}")
    counts = re.match(re.escape(_OBJ_COUNTS).replace(r"\{\}", r"(\d+)").encode(), data)
    if counts:
        require_all("vertex", len(vertices), int(counts[1]))
        require_all("face", len(faces), int(counts[2]))
    require_triangles([len(face) for face in faces])
    vertices = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    comments = [line for line in data.decode("latin-1").splitlines() if line.startswith("#")]
    vertices = in_ras(path, vertices, "\n".join(comments))
    return vertices, np.array(faces, dtype=np.int64).reshape(-1, 3)


def write_obj(surface):
    """OBJ with as many digits as float64 needs."""
    counts = _OBJ_COUNTS.format(len(surface.vertices), len(surface.faces))
    vertices = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in surface.vertices.tolist())
    faces = "".join(f"f {i} {j} {k}\n" for i, j, k in (surface.faces + 1).tolist())
    return f"{counts}\n{vertices}{faces}".encode()


def require_triangles(sides):
    """FormatError, with the first of them, where faces have other than 3 corners; sides: (F,)."""
    bad = np.flatnonzero(np.not_equal(sides, 3))
    if bad.size:
        raise FormatError(
            f"face {bad[0]} has {sides[bad[0]]} corners, only triangles are read (triangulate the "
            "mesh)"
        )
