"""A script that reads a VTK or VTP file in a process of its own: VTK's readers end the process on
some damaged files, and allocate whatever they announce.

Arguments: the file, and how many further bytes of memory it may take. Exit code 0: points and faces
on stdout, two .npy arrays; 1: the reason as text.
"""

import contextlib
import io
import os
import sys

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkIOLegacy import vtkPolyDataReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader


def read(path):
    """Points (V, 3) and triangles (F, 3) of polygonal data; ValueError with the reason."""
    complaints = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(complaints)
    reader = vtkXMLPolyDataReader() if path.lower().endswith(".vtp") else vtkPolyDataReader()
    reader.SetFileName(os.fsencode(path))
    reader.Update()
    mesh = reader.GetOutput()
    if complaints.GetOutput():
        raise ValueError(
            "VTK finds it damaged, or no polygonal data in it (unstructured grid: extract its "
            "surface)"
        )
    if not mesh.GetNumberOfPolys() or mesh.GetNumberOfStrips():
        raise ValueError(
            "it holds no faces, or triangle strips (split them: pyvista's triangulate)"
        )
    sides = np.diff(vtk_to_numpy(mesh.GetPolys().GetOffsetsArray()))
    if (sides != 3).any():
        bad = np.flatnonzero(sides != 3)[0]
        raise ValueError(
            f"face {bad} has {sides[bad]} corners, only triangles are read (triangulate the mesh)"
        )
    faces = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(mesh.GetPoints().GetData()), faces


def limit_memory(room):
    """Allow `room` further bytes of addresses, where the system has such limits."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        with open("/proc/self/statm", encoding="ascii") as file:
            now = int(file.read().split()[0]) * resource.getpagesize()
        most = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (now + room, most))


if __name__ == "__main__":
    limit_memory(int(sys.argv[2]))
    try:
        arrays = io.BytesIO()
        for array in read(sys.argv[1]):
            np.save(arrays, array)
    except (ValueError, MemoryError) as error:
        sys.stdout.write(str(error) or "it announces more than it holds")
        sys.exit(1)
    sys.stdout.buffer.write(arrays.getvalue())
