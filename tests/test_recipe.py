"""The recipe for a folder of FreeSurfer subjects runs as the page 'Your own brain' prints it."""

import os
import re
import subprocess
import sys
from pathlib import Path

import nibabel
import nilearn
import numpy as np
import pytest
from nilearn.surface import load_surf_mesh

import qclearn as qc
from book.builder.references import markdown_of
from commands import label
from freesurfer import GEOMETRY

WHITE = Path(nilearn.__path__[0], "datasets", "data", "fsaverage5")


def made(folder, surface, cortex):
    """A subject's folder with its left white surface and the label of its cortex."""
    for name in ("surf", "label"):
        (folder / name).mkdir(parents=True)
    nibabel.freesurfer.write_geometry(folder / "surf" / "lh.white", *surface, volume_info=GEOMETRY)
    label(folder / "label" / "lh.cortex.label", cortex)
    nibabel.freesurfer.write_morph_data(folder / "surf" / "lh.thickness", np.full(len(surface[0]), 2.5))


@pytest.mark.slow
def test_a_folder_of_subjects_goes_onto_fsaverage5(tmp_path):
    (recipe,) = re.findall(r"```python\n(import json\nimport subprocess\n.*?)```", markdown_of("ownbrain"), re.DOTALL)
    left, right = (qc.Surface(*load_surf_mesh(WHITE / f"white_{side}.gii.gz")) for side in ("left", "right"))
    cortex, other = (qc.fsaverage5(side).original_vertices for side in ("left", "right"))
    mirrored = qc.mirror(right)
    made(tmp_path / "anna", (left.vertices, left.faces), cortex)
    made(tmp_path / "ben", (mirrored.vertices, mirrored.faces), other)
    bent = left.vertices * [1.06, 0.97, 1.02] + 1.5 * np.sin(left.vertices[:, [1, 2, 0]] / 15)
    made(tmp_path / "cleo", (bent, left.faces), cortex)
    (tmp_path / "fsaverage").symlink_to(tmp_path / "anna")  # FreeSurfer's template beside them
    program = tmp_path / "bin" / "qclearn"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m qclearn "$@"\n')
    program.chmod(0o755)
    known = os.environ | {"PATH": f"{program.parent}:{os.environ['PATH']}"}
    for _ in range(2):  # the second time it skips what is there
        subprocess.run([sys.executable, "-c", recipe], cwd=tmp_path, env=known, check=True)
    assert {path.name for path in (tmp_path / "qc").iterdir()} == {"anna", "ben", "cleo"}
    carried = [qc.read_values(tmp_path / "qc" / name / "lh.thickness.func.gii") for name in ("anna", "ben", "cleo")]
    assert [len(one) for one in carried] == [len(left.vertices)] * 3 and max(map(np.max, carried)) == 2.5
