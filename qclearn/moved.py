"""What went with version 0.3, and what stands in its place: one line each, until 0.4."""

_OWN = "the page 'Your own brain' (book/ownbrain.ipynb)"
_PYVISTA = (
    "m = pyvista.read(path){}.triangulate(), then qclearn.Surface(m.points, m.regular_faces){}; of "
    "3D Slicer, whose files are in LPS, m.points * [-1, -1, 1]"
)
_WITHOUT = _PYVISTA.format("", " (without clean(), which numbers the vertices anew)")
_TEMPLATE = "fsaverage5 is a common space; 'From pairs to a group' makes one round of an average"
_METHOD = "a method is a Python function; 'How to add a method' has one that runs a program"
_REGIONS = f"compare regions by scikit-learn's f1_score(..., sample_weight=areas), as {_OWN} does"

GONE = {
    # commands and options of the command line
    "qclearn landmarks": f"curves from a label, from points or from fsaverage5 take a few lines: {_OWN}",
    "qclearn template": _TEMPLATE,
    "qclearn grade": "nbgrader grades hand-ins; `make course` writes its folder",
    "qclearn report FOLDER FOLDER": f"a page shows one registration; a table of many is a few lines of pandas: {_OWN}",
    "--annot": _REGIONS,
    "--program": _METHOD,
    "--peers": "measured by python -m book.studies.peers, in a clone of the repository",
    "--sure": "the option is --uncertainty",
    # Python's names and arguments
    "qclearn.template": _TEMPLATE,
    "qclearn.Template": _TEMPLATE,
    "qclearn.TemplateError": f"{_TEMPLATE}; register in a loop, by joblib for many",
    "qclearn.WorkersError": "the error is qclearn.benchmark.BenchmarkError",
    "register(annotations=)": _REGIONS,
    "benchmark(programs=)": _METHOD,
    "benchmark(peers=)": "measured by python -m book.studies.peers",
    # formats of surfaces
    **dict.fromkeys((".vtk", ".vtp"), _WITHOUT),
    ".stl": _PYVISTA.format(".clean()", ""),
    ".off": "m = trimesh.load(path, process=False), then qclearn.Surface(m.vertices, m.faces)",
    "MNI's .obj": "the page 'Files, formats and exit codes' reads it in eight lines",
}


def gone(name):
    """The line of a `name` of GONE."""
    return f"{name} went with version 0.3: {GONE[name]}"
