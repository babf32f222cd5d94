"""Formats that are known by content or name and not read here: what each is, and the way from it."""

import contextlib

import nibabel

from ..surfaces.surface import SurfaceError

_CIFTI = (
    "CIFTI holds both hemispheres and volumes at once: take one surface's map out, wb_command "
    "-cifti-separate IN COLUMN -metric CORTEX_LEFT OUT.func.gii (-label for a .dlabel.nii)"
)
_OVERLAY = "a surface's map in NIfTI: mri_convert IN OUT.mgh"
_VOLUME = "a volume: mri_vol2surf or wb_command -volume-to-surface-mapping"
NIFTI = f"{_CIFTI}; {_OVERLAY}; {_VOLUME}"
_AFNI = "AFNI's format; convert it: ConvertDset -o_gii -input IN -prefix OUT"
_BRAINVISA = "BrainVISA's format; convert it: AimsFileConvert -i IN -o OUT.gii"
_TABLE = "a table; save the column of a map: numpy.savetxt('OUT.txt', pandas.read_{}(IN)['NAME'])"
_ARRAYS = "save a map by numpy.save('OUT.npy', {}); a surface is qclearn.Surface(vertices, faces)"
BY_SUFFIX = {
    ".asc": "FreeSurfer's text; convert a surface: mris_convert IN OUT.surf.gii; of a map, save the "
    "last column as .txt",
    **dict.fromkeys((".dset", ".1d", ".niml"), _AFNI),
    **dict.fromkeys((".mesh", ".tri", ".tex"), _BRAINVISA),
    ".srf": "BrainVoyager's surface; bvbabel.srf.read_srf(path) gives its vertices and faces",
    ".smp": "BrainVoyager's maps; bvbabel.smp.read_smp(path) gives them: numpy.save('OUT.npy', map)",
    ".dfs": "BrainSuite's; s = dfsio.readdfs(path), then qclearn.Surface(s.vertices, s.faces)",
    ".csv": _TABLE.format("csv"),
    ".tsv": _TABLE.format("table"),
    ".xlsx": _TABLE.format("excel"),
    ".mat": _ARRAYS.format("scipy.io.loadmat(IN)['NAME']") + ", faces from 0 on",
    **dict.fromkeys((".h5", ".hdf5"), _ARRAYS.format("h5py.File(IN)['NAME'][:]")),
    **dict.fromkeys((".mnc", ".nrrd", ".img", ".hdr"), f"mri_convert IN OUT.nii.gz, {_VOLUME}"),
}
# What FreeSurfer's binary files hold.
SURFACE = "is a FreeSurfer surface, not values at its vertices; give a map such as lh.thickness"
MAP = "holds what belongs to a surface's vertices (lh.thickness), no surface; give that (lh.pial)"
_PATCH = (
    "is a FreeSurfer patch, vertices without faces; give the surface that it is a part of, such as "
    "lh.pial, or convert it: mris_convert -p IN OUT.surf.gii"
)
_QUADS = "holds quadrangles, FreeSurfer's old format; convert it: mris_convert IN OUT.surf.gii"


def freesurfer_kind(data):
    """SURFACE, MAP or what else the first bytes of a FreeSurfer file say, None for other files."""
    if data.startswith(b"\xff\xff\xfe"):
        return SURFACE
    if data.startswith(b"\xff\xff\xff\xff"):
        return _PATCH
    if data.startswith(b"\xff\xff\xff") and data[11:15] in (b"\0\0\0\1", b""):  # values a vertex
        return MAP
    return _QUADS if data.startswith((b"\xff\xff\xff", b"\xff\xff\xfd")) else None


def refuse_foreign(path):
    """SurfaceError for a NIfTI, by its header, and for a suffix of another program, unless it is
    FreeSurfer's by its content."""
    name = path.name.lower()
    suffix = ".nii" if name.endswith(".nii.gz") else path.suffix.lower()
    known = suffix == ".nii" or (suffix in BY_SUFFIX and not name.endswith(".gii.dset"))
    start = b""
    with contextlib.suppress(OSError), path.open("rb") as file:
        start = file.read(16)
    if not (known and start) or freesurfer_kind(start):
        return
    reason = BY_SUFFIX.get(suffix, NIFTI)
    if suffix == ".nii":
        with contextlib.suppress(Exception):  # of a damaged one all three are named
            image = nibabel.load(path)
            reason = _VOLUME if min(image.shape[:3]) > 1 else _OVERLAY
            reason = _CIFTI if isinstance(image, nibabel.Cifti2Image) else reason
    raise SurfaceError(f"{path}: {suffix} files are not read here; {reason}")
