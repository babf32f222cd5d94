"""`qclearn sphere`: the whole registered hemisphere on the control's sphere."""

import click
import numpy as np

import qclearn as qc

from ..io.frames import Frame
from ..io.fsaverage import whole_fsaverage5
from ..io.hemisphere import NAMED, require_side
from ..io.mapfile import frame_of_side, numbering_of_side, read_registration
from ..io.meshes import frame_of
from ..io.safe import naming
from ..io.sphere import RINGS, registered_sphere, require_whole, unit_sphere
from ..registration.report import distortion_maps
from .output import output_folder, say

OTHER = {"left": "right", "right": "left", None: None}
SPHERE_FILES = ["sphere.reg", "sphere.reg.surf.gii"]
DISTORTION_FILES = ["ArealDistortion.shape.gii", "ShapeDistortion.shape.gii"]
FILES = SPHERE_FILES + DISTORTION_FILES


@click.command()
@click.argument("registration")
@click.argument("control_sphere")
@click.option("--out", required=True, help="Folder for the sphere and two maps of distortion.")
def sphere(registration, control_sphere, out):
    """Lay the moving hemisphere of a REGISTRATION (registration.npz), whole, on the CONTROL_SPHERE.

    CONTROL_SPHERE is lh.sphere or lh.sphere.reg of the control, or fsaverage5:left,
    fsaverage5:right; any radius is scaled to 100. If the control is a person, take its sphere.reg,
    which leads on to fsaverage.

    Workbench, values from the moving surface to the control; for the way back exchange the spheres:

    \b
        wb_command -metric-resample IN.func.gii DIR/sphere.reg.surf.gii \\
          CONTROL_SPHERE.surf.gii BARYCENTRIC OUT.func.gii

    FreeSurfer, under a name that is not the subject's own sphere.reg:

    \b
        cp DIR/sphere.reg $SUBJECTS_DIR/SUBJECT/surf/lh.qclearn.sphere.reg
        mri_surf2surf --srcsubject SUBJECT --trgsubject fsaverage5 --hemi lh \\
          --srcsurfreg qclearn.sphere.reg --trgsurfreg sphere.reg \\
          --sval lh.thickness --tval OUT.mgh --cortex

    The sphere lies on the control's hemisphere, and says so: of a right surface registered with
    --mirror it is a left one, with the faces of the mirrored surface. Workbench takes maps of the
    right one with it as they are, and a map keeps its structure when it is resampled
    (-set-structure tells where it lies now). FreeSurfer keeps such a surface as lh in
    SUBJECT/xhemi/surf, where the sphere and the right one's maps are named lh, too.

    ArealDistortion.shape.gii is log2 of the area around each vertex on the registered surface, by
    that on the moving one, as wb_command -surface-distortion has it, and ShapeDistortion.shape.gii
    log2 of the ratio of the principal stretches; both are of the moving hemisphere, 0 on its wall.
    """
    arrays = read_registration(registration)
    for side in ("moving", "control"):
        table, faces = arrays.get(f"table_{side}"), arrays.get(f"whole_faces_{side}")
        with naming(registration):
            require_whole(side, table, faces)
    hemisphere = frame_of_side(arrays, "control").side
    given = read_sphere(control_sphere, arrays["whole_faces_control"], hemisphere)
    with output_folder(out) as folder:
        line = write_sphere(folder, arrays, given)
    say(f"{out}: {line}")


def read_sphere(path, faces, side):
    """The control's sphere of a file or of a name such as fsaverage5:left, and the hemisphere that
    it names; SurfaceError, with the path, where it cannot be that of a control with these whole
    `faces` (F, 3) of the hemisphere `side`."""
    named = NAMED.fullmatch(str(path))
    own = named[1] if named else frame_of(path).side
    surface = whole_fsaverage5(own) if named else qc.read_surface(path)
    require_side(path, own, side, "the control")
    with naming(path):
        unit_sphere(surface, faces)
    return surface, own or side


def sphere_of(sides, path):
    """`read_sphere` for two `Hemisphere`s, dict side -> one, that will be registered."""
    for side, one in sides.items():
        with naming(one.path):
            require_whole(side, one.cut_surface.original_vertices, one.frame.whole)
    frame = sides["control"].frame
    return read_sphere(path, frame.whole, frame.side)


def write_sphere(folder, arrays, given):
    """Write a registration's sphere on the control's, as of `read_sphere`, and its distortion; a
    line on it."""
    ball, side = given
    surface, moved, rings = registered_sphere(arrays, ball)
    own = frame_of_side(arrays, "moving").side
    frame = Frame(side or (OTHER[own] if arrays["mirrored"] else own), kind="Spherical")
    for name in SPHERE_FILES:
        qc.write_surface(folder / name, surface, frame=frame)
    # In single precision, as the files store them.
    names = "vertices_moving", "points"
    here, there = (arrays[name].astype(np.float32).astype(float) for name in names)
    maps = distortion_maps(here, arrays["faces_moving"], there)
    for name, values in zip(DISTORTION_FILES, maps):
        whole = numbering_of_side(arrays, "moving").on_whole(values, 0)
        qc.write_values(folder / name, whole, own, names=[name.split(".")[0]])
    depth = rings[moved]
    return (
        f"{len(surface.vertices)} vertices on the control's sphere, no face flipped; untangling "
        f"moved {(depth == 0).sum()} on the wall and {(depth > 0).sum()} on the cortex, "
        f"{(depth > RINGS).sum()} of them more than {RINGS - 1} rings from its rim"
    )
