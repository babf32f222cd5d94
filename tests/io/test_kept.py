"""What 'Files, formats and exit codes' promises to keep of a surface, read back by other programs where they can."""

import nibabel
import numpy as np
import pytest
from nibabel.freesurfer import read_geometry, write_geometry

from freesurfer import GEOMETRY
from known_surfaces import sphere
from qclearn.io.meshes import frame_of, read_surface, write_surface
from qclearn.surfaces.surface import Surface

BALL, TKR = sphere(), b"\0\0\0\2\0\0\0\0\0\0\0\x14"
STORED, SCANNER = np.float32(50 * BALL.vertices), TKR[:7] + b"\1" + TKR[8:]
CURVES, NUMBERS = {"a b": [0, 1, 2]}, np.arange(3, 3 + len(STORED))
VOLUME = ("volume", "voxelsize", "xras", "yras", "zras", "cras", "filename")
VOLGEOM = [*("Width", "Height", "Depth", "Xsize", "Ysize", "Zsize"), *(f"{x}_{a}" for x in "XYZC" for a in "RAS")]
FREESURFER, GIFTI, NPZ, PLY, OBJ = "lh.white", "lh.white.surf.gii", "a.npz", "a.ply", "a.obj"
# format -> the promises that it keeps
KEPT = {PLY: ("faces", "coordinates"), OBJ: ("faces", "coordinates")}
KEPT[FREESURFER] = (*KEPT[PLY], "volume", "in scanner", "side", "kind")
KEPT[GIFTI], KEPT[NPZ] = (*KEPT[FREESURFER], "numbers"), (*KEPT[FREESURFER], "numbers", "curves")


def found(path):
    """What a file says of each promise, by other programs where they read it."""
    again, frame = read_surface(path), frame_of(path)
    told = {"faces": again.faces, "coordinates": again.vertices, "numbers": again.original_vertices}
    told |= {"kind": frame.kind, "side": frame.side, "in scanner": frame.in_scanner}
    told["curves"] = {name: curve.tolist() for name, curve in again.curves.items()}
    told["volume"] = [frame.volume[key] for key in VOLUME] if frame.volume else None
    if path.name == FREESURFER:
        data = path.read_bytes()
        told["in scanner"] = SCANNER in data
        path.write_bytes(data.replace(SCANNER, TKR))  # nibabel leaves the flag's geometry out
        told["coordinates"], told["faces"], header = read_geometry(path, read_metadata=True)
        told["volume"] = [np.array(header[key]).tolist() for key in VOLUME]
    if path.name == GIFTI:
        points, triangles = nibabel.load(path).darrays
        told |= {"coordinates": points.data, "faces": triangles.data, "in scanner": points.coordsys.dataspace == 1}
        numbers = np.array([float(points.meta[f"VolGeom{key}"]) for key in VOLGEOM])
        told["volume"] = [*numbers.reshape(-1, 3).tolist(), points.meta["VolGeomFname"]]
    return told


@pytest.mark.parametrize("flag", [TKR, SCANNER], ids=["own", "scanner"])
@pytest.mark.parametrize("name", KEPT)
@pytest.mark.parametrize("via", [[], [NPZ], [GIFTI], ["b.npz", "lh.white.surf.gii.gz", NPZ]], ids=str)
def test_each_format_of_a_surface_keeps_what_is_promised(tmp_path, name, via, flag):
    """FreeSurfer's coordinates become the scanner's in GIFTI, and its own again; those flagged as such stay."""
    path = tmp_path / "source" / FREESURFER
    path.parent.mkdir()
    write_geometry(path, STORED, BALL.faces, volume_info=GEOMETRY)
    path.write_bytes(path.read_bytes().replace(TKR, flag))
    surface, frame = Surface(STORED, BALL.faces, CURVES, NUMBERS), frame_of(path)
    for step in [*via, name]:
        write_surface(tmp_path / step, surface, frame=frame)
        surface, frame = read_surface(tmp_path / step), frame_of(tmp_path / step)
    told, through = found(tmp_path / name), any("gii" in step for step in via)
    flagged = flag == SCANNER and not (through and name == FREESURFER)
    moved = flagged or through or name == GIFTI if name != FREESURFER else flagged
    place = STORED + np.array(GEOMETRY["cras"]) * (moved - (flag == SCANNER))
    expected = {"faces": BALL.faces, "coordinates": place, "kind": "GrayWhite", "side": "left", "numbers": NUMBERS}
    expected |= {"volume": [GEOMETRY[key] for key in VOLUME], "in scanner": moved, "curves": {} if through else CURVES}
    for promise in KEPT[name]:
        same = np.allclose if promise in ("faces", "coordinates", "numbers") else lambda a, b: a == b
        assert same(told[promise], expected[promise]), (promise, told[promise], expected[promise])
