"""Damaged files, each made again from seed and number, are read as sound or refused in one line that names them."""

import gzip
import io
import json
import random
import re
import warnings
import zipfile
from contextlib import suppress

import nibabel
import numpy as np
import pytest

import qclearn as qc
from qclearn.io.frames import Frame
from qclearn.io.meshes import frame_of
from qclearn.registration.curves import check_curves, read_landmarks

NUMBERS = [0, 1, 2, 255, 65535, 10**6, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 10**30, -1, -128]
WORDS = [b"nan", b"inf", b"-inf", b"1e308", b"1e999", b"1.5", b"", b"0x1f", b"9" * 5000, b"1_0", "\u0663".encode()]
LETTERS = [b" ", b"\n", b"-", b".", b'"', b"<", b">", b"&", b"[", b"{", b"\0", b"\x1b[2J"]
AXES = {"xras": [-1.0, 0, 0], "yras": [0.0, 0, -1], "zras": [0.0, 1, 0], "cras": [3.5, 12.25, -7.0]}
VOLUME = {"head": [2, 0, 20], "valid": "1", "filename": "orig.mgz", "volume": [256] * 3, "voxelsize": [1.0] * 3}


Z, FACES = qc.polar_disk(4, 12)
# A disk of 49 vertices in space, with two curves.
POINTS = np.stack([Z.real, Z.imag, 0.6 * (1 - abs(Z) ** 2)], axis=1) * 50
BOWL = qc.Surface(POINTS, FACES, {"a": [0, 1, 13], "b": [5, 17]})


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """name -> bytes: sound files in every format that is read."""
    folder, count = tmp_path_factory.mktemp("sound"), len(POINTS)
    frame = Frame("left", "tkr", VOLUME | AXES, "Pial", count, FACES)
    for name in ("s.npz", "s.gii", "s.gii.gz", "s.ply", "s.obj", "lh.pial"):
        qc.write_surface(folder / name, BOWL, frame=frame)
    for name in ("v.npy", "v.txt", "v.shape.gii", "v.func.gii.gz", "v.mgh", "v.mgz", "lh.thickness"):
        qc.write_values(folder / name, POINTS[:, 2])
    for name in ("v.label.gii", "lh.regions.annot"):
        qc.write_values(folder / name, np.arange(count) % 5)
    (folder / "m.label").write_text("#!ascii label\n12\n" + "".join(f"{k} 1.0 2.0 3.0 0.0\n" for k in range(12)))
    (folder / "c.json").write_text(json.dumps({"curves": [{"name": "a", "moving": [0, 40], "control": [3, 45]}]}))
    image = nibabel.load(folder / "s.gii")
    for array in image.darrays:
        array.encoding = 1  # ASCII
    (folder / "ascii.gii").write_bytes(image.to_bytes())
    header = f"ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(FACES)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = (*POINTS.tolist(), *([3, *face] for face in FACES.tolist()))
    (folder / "ascii.ply").write_text(header + "".join(" ".join(map(str, row)) + "\n" for row in rows))
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def mutated(data, dice):
    """Bytes with one kind of damage: bits, cuts, repeats, binary integers, numbers and words in headers."""
    data, place, length = bytearray(data), dice.randrange(len(data)), dice.choice([1, 2, 4, 12, 64, 400])
    if (kind := dice.randrange(8)) == 0:
        for _ in range(dice.choice([1, 8])):
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    elif kind < 6:  # what stands at a place, and how much of it goes
        more = dice.choice([data[place : place + length], dice.randbytes(length), b"\0" * length])
        number = (dice.choice(NUMBERS) % 2**32).to_bytes(4, dice.choice(["big", "little"]))
        put, gone = [(b"", len(data)), (b"", length), (more, 0), (dice.choice(LETTERS), 1), (number, 4)][kind - 1]
        data[place : place + gone] = put
    else:
        head = bytes(data[: dice.choice([200, 1500, len(data)])])
        if found := list(re.finditer(rb"\d+", head))[: 16 if kind == 6 else None]:
            start, end = dice.choice(found).span()
            data[start:end] = dice.choice([str(dice.choice(NUMBERS)).encode(), dice.choice(WORDS)])
    return re.sub(rb'Dimensionality="\d{7,}', b'Dimensionality="7', data)  # nibabel counts up to it


def damaged(name, data, dice):
    """A sound file's bytes with one damage, in half the cases inside its compression."""
    if name.endswith((".gz", ".mgz")) and dice.random() < 0.7:
        return gzip.compress(mutated(gzip.decompress(data), dice))
    if name.endswith(".npz") and dice.random() < 0.6:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {member: archive.read(member) for member in archive.namelist()}
        victim, packed = dice.choice(list(members)), io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for member, content in members.items():
                archive.writestr(member, mutated(content, dice) if member == victim else content)
        return packed.getvalue()
    return mutated(data, dice)


def consume(path):
    """Whether a file is read, by what its name says, as something sound, or refused by name."""
    try:
        if path.suffix == ".json":
            landmarks = read_landmarks(path)
            with suppress(qc.LandmarkError):  # which knows no file
                check_curves(landmarks, BOWL, BOWL)
        elif path.suffix == ".label":
            assert qc.read_mask(path, BOWL).shape == (len(POINTS),)
        elif path.name.startswith("v.") or path.name in ("lh.thickness", "lh.regions.annot"):
            values = qc.read_values(path)
            assert values.ndim in (1, 2) and values.dtype.kind in "biuf"
        else:
            read = qc.read_surface(path)
            frame_of(path)
            assert np.isfinite(read.vertices).all() and 0 <= read.faces.min() <= read.faces.max() < len(read.vertices)
    except (qc.SurfaceError, qc.LandmarkError) as error:
        text = str(error)
        assert path.name in text and "\n" not in text and "\x1b" not in text and len(text) < 3000
        return False
    return True


def test_sound_files_are_read(sound, tmp_path):
    for name, data in sound.items():
        (tmp_path / name).write_bytes(data)
        assert consume(tmp_path / name), name


@pytest.mark.parametrize("seed", [1, *[pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 12)]])
def test_damaged_files_are_refused_by_name_or_read_as_sound(sound, tmp_path, seed):
    read = 0
    for number in range(200):
        dice = random.Random(f"test {seed} {number}")
        name = dice.choice(list(sound))
        (tmp_path / name).write_bytes(damaged(name, sound[name], dice))
        with warnings.catch_warnings(record=True):  # what is left out is said on purpose
            read += consume(tmp_path / name)
    assert read < 100
