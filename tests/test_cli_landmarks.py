"""`qclearn landmarks`: curves from labels, points and fsaverage5 become a landmarks file; bad ones
a line."""

import json
import re
from dataclasses import replace
from functools import cache

import nibabel
import numpy as np
import pytest

from qclearn.io.fsaverage import demo_landmarks, fsaverage5, whole_fsaverage5
from qclearn.io.meshes import frame_of, read_surface, write_surface
from qclearn.registration.curves import check_curves, fundus_metric, fundus_path, read_landmarks, read_points
from qclearn.registration.problem import LandmarkError
from qclearn.surfaces.surface import Surface
from test_cli import bowl, refused, run

CRAS = np.array([5.0, -18.0, 7.0])
HEADER = "name,side,order,x,y,z\n"


def write_label(path, numbers):
    rows = [f"{number} 0 0 0 0" for number in numbers]
    path.write_text("\n".join(["#!ascii label", str(len(rows)), *rows]) + "\n")
    return path


def dented(surface, seed):
    """The surface smoothly bent by up to 3 mm, its vertices renumbered, as another person's; and
    the new numbers."""
    rng = np.random.default_rng(seed)
    waves = np.sin(surface.vertices @ rng.normal(size=(3, 3)) * 0.05 + rng.uniform(0, 6, 3))
    order = rng.permutation(len(surface.vertices))
    number = np.argsort(order)
    whole = surface.original_vertices[order]
    return Surface((surface.vertices + 3 * waves)[order], number[surface.faces], original_vertices=whole), number


@pytest.fixture(scope="module")
def brains(tmp_path_factory):
    """A folder with a bent and renumbered right hemisphere of fsaverage5; the new numbers."""
    folder = tmp_path_factory.mktemp("brains")
    right, number = dented(fsaverage5("right"), 3)
    write_surface(folder / "rh.npz", right)
    return folder, number


@cache
def true_paths():
    """Name -> the fundus paths of fsaverage5's right and left hemisphere, which begin at the same
    end."""
    surfaces = {"moving": fsaverage5("right"), "control": fsaverage5("left")}
    metrics = {side: fundus_metric(surface) for side, surface in surfaces.items()}
    return {
        curve["name"]: {side: fundus_path(one, *curve[side], metrics[side]) for side, one in surfaces.items()}
        for curve in demo_landmarks()["curves"]
    }


def test_labels_and_carried_curves_become_a_landmarks_file(brains, capsys):
    """Shuffled labels in whole numbers keep their curves and pair the same ends; carried ones end
    near theirs."""
    folder, number = brains
    right, left, rng = fsaverage5("right"), fsaverage5("left"), np.random.default_rng(0)
    words, paths = [], true_paths()
    for k, (name, path) in enumerate(paths.items()):
        here = write_label(folder / f"rh.{k}.label", rng.permutation(right.original_vertices[path["moving"]]))
        there = write_label(folder / f"lh.{k}.label", rng.permutation(left.original_vertices[path["control"]]))
        words += ["--label", f"my {name}", here, there]
    out, carry = folder / "landmarks.json", ["--carry", "fsaverage5", "--mirror"]
    run("landmarks", folder / "rh.npz", "fsaverage5:left", *words, *carry, "--out", out)
    contents, bent = read_landmarks(out), dented(right, 3)[0]
    entries = {curve.name: curve for curve in check_curves(contents, bent, whole_fsaverage5("left", "pial"))}
    said, apart = capsys.readouterr().out, []
    for name, path in paths.items():
        mine, found = entries[f"my {name}"], entries[name]
        ends = (number[path["moving"][[0, -1]]].tolist(), left.original_vertices[path["control"][[0, -1]]].tolist())
        pair = [mine.path(side)[[0, -1]].tolist() for side in ("moving", "control")]
        assert pair == [*ends] or pair == [end[::-1] for end in ends]
        assert found.control.tolist() == ends[1] and found.detect == {"moving": True, "control": True}
        apart.append(np.linalg.norm(bent.vertices[found.moving] - bent.vertices[ends[0]], axis=1))
        assert f"{name}: moving {contents['off_fundus_mm'][name]['moving']:.1f} mm from the fundus" in said
        assert contents["off_fundus_mm"][name]["control"] is None
    assert np.mean(apart) < 2 and np.max(apart) < 8


def test_a_forgotten_mirror_is_seen_by_the_folds_where_no_name_tells(brains, capsys):
    folder, _ = brains
    write_surface(folder / "someone.npz", dented(fsaverage5("right"), 3)[0])
    path = true_paths()["central sulcus"]
    here = write_label(folder / "here.label", fsaverage5("right").original_vertices[path["moving"]])
    there = write_label(folder / "there.label", fsaverage5("left").original_vertices[path["control"]])
    words = ["--label", "central sulcus", here, there, "--out", folder / "l.json"]
    line = refused(capsys, folder, "landmarks", folder / "someone.npz", "fsaverage5:left", *words)
    assert "mirror: the folds fit the mirrored moving surface much better" in line


@pytest.fixture
def folder(tmp_path):
    """A folder with two bowls in mm, one with a FreeSurfer header; labels and points."""
    for name, height in (("lh.moving", 0.6), ("lh.control", 0.9)):
        one = bowl(height)
        frame = {
            "head": np.array([2, 0, 20]),
            "valid": "1",
            "filename": "x",
            "volume": [256] * 3,
            "voxelsize": [1.0] * 3,
        }
        frame |= {"xras": [-1.0, 0, 0], "yras": [0, 0, -1.0], "zras": [0, 1.0, 0], "cras": CRAS}
        nibabel.freesurfer.write_geometry(tmp_path / name, 30 * one.vertices, one.faces, volume_info=frame)
    write_label(tmp_path / "east.label", [1, 49, 25, 73, 97])
    write_label(tmp_path / "filled.label", range(100))
    write_label(tmp_path / "pieces.label", [1, 25, 97, 121])
    write_label(tmp_path / "far.label", [1, 999])
    write_label(tmp_path / "rh.east.label", [1, 25, 49])
    (tmp_path / "empty.label").write_text("#!ascii label\n0\n")
    return tmp_path


def rows(side, *points, shift=0):
    """Lines of a csv file, points of a surface in 30 mm, moved by a shift."""
    return "".join(
        f"east,{side},{k},{','.join(map(str, point))}\n" for k, point in enumerate(np.array(points) * 30 + shift)
    )


def write_points(folder, shift=0.0):
    z = {side: bowl(height).vertices[[1, 49, 97]] for side, height in (("moving", 0.6), ("control", 0.9))}
    text = HEADER + "".join(rows(side, *points, shift=shift) for side, points in z.items())
    (folder / "points.csv").write_text(text)


@pytest.mark.parametrize("space, shift", [(None, 0), ("tkr", 0), ("scanner", CRAS)])
def test_points_find_their_vertices_in_either_space(folder, space, shift, capsys):
    write_points(folder, shift + 0.5)
    words = ["--space", space] if space else []
    run("landmarks", folder / "lh.moving", folder / "lh.control", "--points", folder / "points.csv", *words,
        "--out", folder / "l.json")  # fmt: skip
    (curve,) = json.loads((folder / "l.json").read_text())["curves"]
    for side in ("moving", "control"):
        assert curve[side][0] == 1 and curve[side][-1] == 97 and 49 in curve[side]
    assert "moving: points 0.9 mm from the nearest vertices, at most 0.9" in capsys.readouterr().out


@pytest.mark.parametrize("scale, message", [
    (1e-3, r"units: the moving surface is 0.06 long.*--units m"), (1 / 30, r"is \d+\.\d mm from the surface; check"),
    (30.0, "in m all are near it|is .* mm from the surface; check the coordinates"),
])  # fmt: skip
def test_points_in_mm_and_surfaces_in_other_units_are_one_line(folder, scale, message, capsys):
    write_points(folder)
    for name, height in (("m.npz", 0.6), ("c.npz", 0.9)):
        one = bowl(height)
        write_surface(folder / name, Surface(30 * scale * one.vertices, one.faces))
    words = (
        "landmarks",
        folder / "m.npz",
        folder / "c.npz",
        "--points",
        folder / "points.csv",
        "--out",
        folder / "l.json",
    )
    assert re.search(message, refused(capsys, folder, *words))
    if scale == 1e-3:
        run(*words, "--units", "m")
        assert "at most 0.0" in capsys.readouterr().out


def test_points_in_metres_are_told(folder, capsys):
    write_points(folder)
    head, *lines = (folder / "points.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines]
    text = "".join(",".join([*row[:3], *(f"{float(x) / 1e3:.17g}" for x in row[3:])]) + "\n" for row in rows)
    (folder / "points.csv").write_text(head + "\n" + text)
    words = folder / "lh.moving", folder / "lh.control", "--points", folder / "points.csv", "--out", folder / "l.json"
    assert "in m all are near it: give them in mm" in refused(capsys, folder, "landmarks", *words)


def test_two_points_are_ends_and_begin_comes_first(folder):
    ends = bowl(0.6).vertices[[1, 97]] * 30
    words = {"End": ends[1], "begin": ends[0]}
    lines = [
        f"a;{side};{word};{';'.join(map(str, at))}" for side in ("moving", "control") for word, at in words.items()
    ]
    (folder / "points.csv").write_text("\ufeff" + HEADER.replace(",", ";") + "\n".join(lines))
    run(
        "landmarks",
        folder / "lh.moving",
        folder / "lh.moving",
        "--points",
        folder / "points.csv",
        "--out",
        folder / "l",
    )
    assert json.loads((folder / "l").read_text())["curves"] == [{"name": "a", "moving": [1, 97], "control": [1, 97]}]


TABLE = [["Name", "side ", "order", "x", "y", "z"]]
TABLE += [["Sulcus \xe9", side, str(k), "0.5", str(k), "-1.25"] for side in ("moving", "control") for k in range(2)]


@pytest.mark.parametrize(
    "separator, decimal, end, encoding",
    [
        (",", ".", "\r", "utf-8"),  # Excel for the Mac
        (";", ",", "\r\n", "utf-8-sig"),  # Excel in Europe
        ("\t", ",", "\r\n", "utf-8"),
        (";", ".", "\n", "utf-8"),
    ],
)
def test_tables_of_any_excel_are_read(tmp_path, separator, decimal, end, encoding):
    rows = [*TABLE, [""] * 6, [" "] * 6, []]
    text = end.join(separator.join(cell.replace(".", decimal) for cell in row) for row in rows)
    (tmp_path / "points.csv").write_bytes((text + end).encode(encoding))
    points = read_points(tmp_path / "points.csv")
    assert list(points) == ["Sulcus \xe9"]
    for side in ("moving", "control"):
        assert points["Sulcus \xe9"][side].tolist() == [[0.5, 0, -1.25], [0.5, 1, -1.25]]


def test_a_table_of_r_has_more_columns_and_a_cell_may_have_two_lines(tmp_path):
    rows = [f'"{k}","central\n sulcus","{side}",{k},1.5,{k},0' for side in ("moving", "control") for k in range(2)]
    (tmp_path / "points.csv").write_text("\n".join(['"","name","side","order","x","y","z"', *rows]))
    assert list(read_points(tmp_path / "points.csv")) == ["central sulcus"]


def test_letters_that_are_no_utf8_are_refused_with_their_line(tmp_path):
    (tmp_path / "points.csv").write_bytes(HEADER.encode() + "caf\xe9,moving,0,0,0,0".encode("cp1252"))
    with pytest.raises(LandmarkError, match="points.csv, line 2: not a text file in UTF-8; export"):
        read_points(tmp_path / "points.csv")


def test_labels_of_a_cut_surface_say_what_was_cut_away_and_what_never_was_there(folder, capsys):
    """Numbers of the whole surface, of 300 vertices, of which 107 were cut away."""
    table = np.r_[0:193] + 107
    for name in ("lh.moving", "lh.control"):
        frame = replace(frame_of(folder / name), count=300)
        write_surface(folder / f"{name}.npz", read_surface(folder / name), table, frame)
    write_label(folder / "whole.label", [108, 156, 132, 180, 204, 7, 8])
    write_label(folder / "other.label", [108, 156, 301])
    pair = folder / "lh.moving.npz", folder / "lh.control.npz"
    words = "--label", "a", folder / "whole.label"
    run("landmarks", *pair, *words, folder / "whole.label", "--out", folder / "l.json")
    assert f"a: 2 of the 7 vertices of {folder / 'whole.label'} are cut away" in capsys.readouterr().out
    line = refused(capsys, folder, "landmarks", *pair, *words, folder / "other.label", "--out", folder / "m.json")
    assert re.search(r"other.label \(a\): names vertex 301, and the surface has 300: .*to another surface", line)


@pytest.mark.parametrize(
    "words, message",
    [
        ([], "needs --label, --points or --carry"),
        (["--space", "tkr", "--carry", "fsaverage5"], "--space belongs to --points"),
        (["--label", "a", "filled.label", "east.label"], r"filled.label \(a\): no curve: its 100 vertices reach"),
        (["--label", "a", "east.label", "empty.label"], r"empty.label \(a\): 0 vertices"),
        (["--label", "a", "east.label", "pieces.label"], r"pieces.label \(a\): in 2 pieces"),
        (["--label", "a", "far.label", "east.label"], "names vertex 999, and the surface has 193: .*npz.*another"),
        (
            ["--label", "a", "rh.east.label", "east.label"],
            "rh.east.label: is of the right hemisphere, .* of the left one",
        ),
        (["--label", "a", "none.label", "east.label"], "none.label: cannot be read"),
        (["--label", "a", "east.label", "east.label", "--mirror"], "leave out --mirror"),
        (["--points", "lh.moving"], "not a text file"),
        (["--label", "a\tb", "east.label", "east.label"], r"the name 'a\\tb' is longer than 200 characters or holds"),
        (["--points", "points.csv"], r"'east', moving side: the point .* mm from the surface; in scanner .* --space"),
    ],
)
def test_bad_input_is_one_line(folder, capsys, words, message):
    write_points(folder, CRAS)
    words = [folder / word if word[-6:] in (".label", "ts.csv", "moving") else word for word in words]
    line = refused(
        capsys, folder, "landmarks", folder / "lh.moving", folder / "lh.control", *words, "--out", folder / "l.json"
    )
    assert re.search(message, line), line


@pytest.mark.parametrize(
    "text, message",
    [
        ("name,side,x,y,z\n", "no column order"),
        (HEADER + "a,left,1,0,0,0\n", "line 2: the side is 'left'; write moving or control"),
        (HEADER + "a,moving,first,0,0,0\n", "line 2: order must be a number, begin or end"),
        (HEADER + "a,moving,1,0,0,\n", "x, y, z numbers in mm"),
        (HEADER + "a,moving,1,0,0,nan\n", "line 2: not a finite number"),
        (HEADER + "a,moving,1,0,0,0\na,moving,1.0,0,0,0\n", "line 3: 'a' has this place twice on the moving side"),
        (HEADER + "a,moving,1,0,0,0\na,moving,2,0,0,0\n", "'a' has fewer than two points on the control side"),
        (HEADER, "holds no points"),
        ("side,order,x,y,z,name\nmoving,0,1,2,3\n", "line 2: its cells are not as many as the first line's"),
        (HEADER + "a,moving,1,0,5,1,5,2,5\n", "line 2: its cells are not as many"),
        (HEADER + "\n,,,,,\n" + "a" * 140_000 + ",moving,1,0,0,0\n", "line 4: field larger than field limit"),
        (HEADER + " ,moving,1,0,0,0\n", "line 2: no name"),
        ("name,side,order,x,y,z,x\n", "no column x, or two"),
        (HEADER + "a\x1b[31m,moving,1,0,0,0\n" * 2, "'a\\x1b[31m' has this place twice"),
    ],
)
def test_bad_tables_are_one_line(folder, capsys, text, message):
    (folder / "points.csv").write_text(text)
    line = refused(
        capsys, folder, "landmarks", folder / "lh.moving", folder / "lh.control", "--points", folder / "points.csv",
        "--out", folder / "l.json",
    )  # fmt: skip
    assert message in line
