"""Damaged files against every reader: each must be read as a sound surface or map, or refused in
one line that names it.

    python tests/fuzz/fuzz_readers.py {files,crafted} 2000 --seed 7 [--out ROWS.jsonl]

A case is (seed, number) and is made again from them. Each runs in a forked process with 10 s and 2
GiB of addresses. Verdicts: refused, accepted, and the faults: noisy (it wrote or warned), unnamed
(a message without the file, or of several lines), raw (another exception), wrong (accepted, but not
sound), memory (over 600 MB more than before), hang, crash.
"""

import base64
import gzip
import io
import json
import os
import random
import resource
import tempfile
import warnings
import zipfile
import zlib
from pathlib import Path

import nibabel
import numpy as np
from forked import forked, read_options, tally  # beside this file

import qclearn as qc
from qclearn.io.frames import Frame
from qclearn.io.meshes import SlitWarning, frame_of
from qclearn.io.safe import LeftOutWarning
from qclearn.registration.curves import check_curves, read_landmarks

SECONDS, ADDRESSES, RESIDENT = 10, 2 << 30, 600 << 20
FAULTS = {"noisy", "unnamed", "raw", "wrong", "memory", "hang", "crash"}
NUMBERS = [0, 1, 2, 255, 65535, 10**6, 5 * 10**8, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 10**30, -1, -128]
WORDS = [b"nan", b"inf", b"-inf", b"1e308", b"1e999", b"1.5", b"", b"0x1f", b"9" * 5000, b"1_0", "\u0663".encode()]


def bowl():
    """A disk of 49 vertices in space, with two curves."""
    z, faces = qc.polar_disk(4, 12)
    points = np.stack([z.real, z.imag, 0.6 * (1 - abs(z) ** 2)], axis=1) * 50
    return qc.Surface(points, faces, {"a": [0, 1, 13], "b": [5, 17]})


def framed(surface):
    """What a file of FreeSurfer's says of a surface, as if it had been cut out of itself."""
    axes = {"xras": [-1.0, 0, 0], "yras": [0.0, 0, -1], "zras": [0.0, 1, 0], "cras": [3.5, 12.25, -7.0]}
    volume = {"head": [2, 0, 20], "valid": "1", "filename": "orig.mgz", "volume": [256] * 3, "voxelsize": [1.0] * 3}
    return Frame("left", "tkr", volume | axes, "Pial", len(surface.vertices), surface.faces)


def bases(folder):
    """name -> bytes: sound files in every format that is read."""
    surface, folder = bowl(), Path(folder)
    heights, labels = surface.vertices[:, 2], np.arange(len(surface.vertices)) % 5
    for name in ("s.npz", "s.gii", "s.gii.gz", "s.ply", "s.obj", "s.off", "s.stl", "s.vtk", "s.vtp", "lh.pial"):
        qc.write_surface(folder / name, surface, frame=framed(surface))
    for name in ("v.npy", "v.txt", "v.shape.gii", "v.func.gii.gz", "v.mgh", "v.mgz", "lh.thickness"):
        qc.write_values(folder / name, heights)
    qc.write_values(folder / "v.label.gii", labels)
    table = np.array([[k * 40, 20, 200 - k * 30, 0, 0] for k in range(5)])
    nibabel.freesurfer.write_annot(
        folder / "lh.regions.annot", labels, table, [f"r{k}" for k in range(5)], fill_ctab=True
    )
    (folder / "m.label").write_text("#!ascii label\n12\n" + "".join(f"{k} 1.0 2.0 3.0 0.0\n" for k in range(12)))
    (folder / "c.json").write_text(json.dumps({"curves": [{"name": "a", "moving": [0, 40], "control": [3, 45]}]}))
    image = nibabel.load(folder / "s.gii")
    for array in image.darrays:
        array.encoding = 1  # ASCII
    (folder / "ascii.gii").write_bytes(image.to_bytes())
    points = " ".join(map(str, surface.vertices.ravel().tolist()))
    corners = " ".join(map(str, surface.faces.ravel()))
    ends = " ".join(str(3 * k + 3) for k in range(len(surface.faces)))
    count = f"{len(surface.vertices)}\n{points}\n\n{points}\n\n{len(surface.faces)}\n0 1 1 1 1"
    (folder / "civet.obj").write_text(f"P 0.3 0.3 0.4 10 1 {count}\n\n{ends}\n\n{corners}\n")
    corners = surface.vertices[surface.faces]
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*p) for p in face)
        + "endloop\nendfacet\n"
        for face in corners.tolist()
    )
    (folder / "ascii.stl").write_text(f"solid s\n{facets}endsolid s\n")
    header = "ply\nformat ascii 1.0\nelement vertex {}\n"
    header += "property float x\nproperty float y\nproperty float z\nelement face {}\n"
    rows = [
        " ".join(map(str, row))
        for row in (*surface.vertices.tolist(), *([3, *face] for face in surface.faces.tolist()))
    ]
    (folder / "ascii.ply").write_text(
        header.format(len(surface.vertices), len(surface.faces))
        + "property list uchar int vertex_indices\nend_header\n"
        + "\n".join(rows)
        + "\n"
    )
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def mutated(data, dice):
    """Bytes with one kind of damage: bits, cuts, repeats, numbers and words in headers, binary
    integers."""
    data, kind = bytearray(data), dice.randrange(8)
    place, length = dice.randrange(len(data)), dice.choice([1, 2, 4, 12, 64, 400])
    if kind == 0:
        for _ in range(dice.choice([1, 8])):
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    elif kind == 1:
        del data[place:]
    elif kind == 2:
        del data[place : place + length]
    elif kind == 3:
        data[place:place] = dice.choice([data[place : place + length], dice.randbytes(length), b"\0" * length])
    elif kind == 4:
        data[place : place + 1] = dice.choice(
            [b" ", b"\n", b"-", b".", b'"', b"<", b">", b"&", b"[", b"{", b"\0", b"\x1b[2J"]
        )
    elif kind == 5:
        data[place : place + 4] = (dice.choice(NUMBERS) % 2**32).to_bytes(4, dice.choice(["big", "little"]))
    else:
        head = bytes(data[: dice.choice([200, 1500, len(data)])])
        starts = [k for k in range(len(head)) if head[k : k + 1].isdigit() and not head[k - 1 : k].isdigit()]
        if starts:
            start = dice.choice(starts[:16] if kind == 6 else starts)
            end = start + len(head[start:]) - len(head[start:].lstrip(b"0123456789"))
            data[start:end] = dice.choice([str(dice.choice(NUMBERS)).encode(), dice.choice(WORDS)])
    return bytes(data)


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


def crafted(sound, blocks=96):
    """(file name, bytes) of attacks: bombs of 16 MiB blocks, announced sizes, entities, expressions
    that backtrack."""
    zeros, gii = bytes(1 << 24), sound["ascii.gii"]
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    bomb = b"".join(packer.compress(zeros) for _ in range(blocks)) + packer.flush()
    yield from (("b.gii.gz", bomb), ("v.func.gii.gz", bomb), ("v.mgz", bomb))
    inner = zlib.compressobj(9)
    inner = base64.b64encode(b"".join(inner.compress(zeros) for _ in range(blocks)) + inner.flush())
    start, end = sound["s.gii"].index(b"<Data>") + 6, sound["s.gii"].index(b"</Data>")
    yield "s.gii", sound["s.gii"][:start] + inner + sound["s.gii"][end:]
    for name in ("s.gii", "v.func.gii"):
        for old, new in (
            (b'Dimensionality="2"', b'Dimensionality="2147483648"'),
            (b'Dim0="49"', b'Dim0="1000000000000"'),
        ):
            yield name, sound["s.gii"].replace(old, new)
    for entity in (b'<!ENTITY a "' + b"1 " * 50000 + b'">', b'<!ENTITY a SYSTEM "file://%s">' % b"/etc/passwd"):
        text = gii[gii.index(b"<GIFTI") :].replace(b"<Data>", b"<Data>" + b"&a;" * 3000)
        yield "s.gii", b'<?xml version="1.0"?><!DOCTYPE GIFTI [' + entity + b"]>" + text
    yield "s.gii", gii.replace(b'Encoding="ASCII"', b'Encoding="ExternalFileBinary"')
    yield "s.stl", b"solid\n endsolid" + b" " * 200_000 + b"\nx"
    yield "s.stl", b"solid\n" + b"endsolid " * 25_000 + b"\nx"
    yield "s.stl", b"solid\n" + b"vertex" + b" " * 200_000 + b"endsolid"
    yield "s.stl", sound["s.stl"][:80] + (1).to_bytes(4, "little") + sound["s.stl"][84:]
    yield (
        "s.vtk",
        (
            b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\n"
            b"POLYGONS 400000000 1600000000\n3 0 1 2\n"
        ),
    )
    yield "s.vtp", sound["s.vtp"].replace(b'NumberOfPoints="49"', b'NumberOfPoints="400000000"')
    counts = sound["lh.pial"].index(b"\n\n") + 2
    yield ("lh.pial", sound["lh.pial"][:counts] + b"\x7f\xff\xff\xff" * 2 + sound["lh.pial"][counts + 8 :])
    for shape in ("(1000000000000000, 3)", "(100000000, 3)", "(-1, 3)"):
        header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
        npy = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(64)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("vertices.npy", npy)
            archive.writestr("faces.npy", sound["v.npy"])
        yield from (("v.npy", npy), ("s.npz", packed.getvalue()))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("curve_x.npy", "w") as member:
        for _ in range(blocks):
            member.write(zeros)
    yield "s.npz", packed.getvalue()
    yield "v.npy", b"\x93NUMPY\x01\x00\xf0\xff" + b"(" * 0xFFF0
    for text in (
        b"[" * 100_000,
        b'{"curves": [{"name": "a", "moving": [1, ' + b"9" * 5000 + b'], "control": [1, 2]}]}',
        b'{"curves": [{"name": "' + b"A" * 10**6 + b'", "moving": [1, 999], "control": [1, 2]}]}',
        b'{"curves": [{"name": "\\u001b]0;x\\u0007", "moving": [1, 999], "control": [1, 2]}]}',
        b"\xef\xbb\xbf" + sound["c.json"],
    ):
        yield "c.json", text


def consume(path):
    """Read a file by what its name says; AssertionError where what comes back is not sound."""
    surface = bowl()
    if path.name.endswith(".json"):
        check_curves(read_landmarks(path), surface, surface)
    elif path.name.endswith(".label"):
        assert qc.read_mask(path, surface).shape == (len(surface.vertices),)
    elif path.name.startswith("v.") or path.name in ("lh.thickness", "lh.regions.annot"):
        values = qc.read_values(path)
        assert values.ndim in (1, 2) and values.dtype.kind in "biuf"
    else:
        read = qc.read_surface(path)
        frame_of(path)
        assert np.isfinite(read.vertices).all() and read.faces.min() >= 0 and read.faces.max() < len(read.vertices)


def verdict(path):
    """(verdict, text) of reading one file in this process; a SlitWarning is no noise."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", SlitWarning)
        try:
            consume(path)
            result = "accepted", ""
        except (qc.SurfaceError, qc.LandmarkError) as error:
            text = str(error)
            named = path.name in text or isinstance(error, qc.LandmarkError)  # of check_curves, which knows no file
            plain = "\n" not in text and len(text) < 3000 and "\x1b" not in text
            result = "refused" if named and plain else "unnamed", text
        except AssertionError as error:
            result = "wrong", repr(error)
        except MemoryError as error:
            result = "memory", repr(error)
        except Exception as error:
            result = "raw", repr(error)
    caught = [one for one in caught if not issubclass(one.category, LeftOutWarning)]  # said on purpose
    return ("noisy", str(caught[0].message)) if caught and result[0] in ("accepted", "refused") else result


def guarded(path, before):
    """`verdict` in a forked process, which may write nothing and take no more than RESIDENT beyond
    `before`."""
    log = path.with_name("log")

    def work():
        for stream in (1, 2):
            os.dup2(os.open(log, os.O_CREAT | os.O_WRONLY | os.O_APPEND), stream)
        found, text = verdict(path)
        peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) * 1024
        return ("memory", found) if peak > before + RESIDENT else (found, text[:300])

    found = forked(work, path.with_name("answer"), SECONDS, ADDRESSES)
    return ("noisy", log.read_text()[:300]) if found[0] not in FAULTS and log.read_bytes() else found


def cases(kind, count, seed, folder):
    """(label, function that makes the file in a folder) of every case."""
    sound = bases(folder)
    if kind == "crafted":
        for number, (name, data) in enumerate(crafted(sound)):
            yield f"{number} {name}", lambda place, name=name, data=data: write(place / name, data)
        return
    names = [name for name in sound for _ in range(1 if ".vt" in name else 4)]  # VTK's take a process each
    for number in range(count):
        dice = random.Random(f"{kind} {seed} {number}")
        name = dice.choice(names)
        yield (
            f"{number} {name}",
            lambda place, name=name, dice=dice: write(place / name, damaged(name, sound[name], dice)),
        )


def write(path, data):
    path.write_bytes(data)
    return path


def main():
    options = read_options(__doc__, ["files", "crafted"])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

    def found(first):
        for label, make in cases(options.kind, options.count, options.seed, first):
            with tempfile.TemporaryDirectory() as folder:
                yield label, *guarded(make(Path(folder)), before)

    with tempfile.TemporaryDirectory() as first:
        tally(found(first), FAULTS, options.out)


if __name__ == "__main__":
    main()
