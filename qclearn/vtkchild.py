"""Run as a script by `files.py`: reads the VTK or VTP file that is named, writes points and faces to stdout.

A process of its own, because VTK's readers end the process on some damaged files. Exit code 0: two .npy arrays, points
and polygons' corners, or 1: the reason as text.
"""

import io
import sys

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkIOLegacy import vtkPolyDataReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader


def read(path):
    """Points (V, 3) and triangles (F, 3) of a file of polygonal data; ValueError with the reason."""
    complaints = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(complaints)
    reader = vtkXMLPolyDataReader() if path.lower().endswith(".vtp") else vtkPolyDataReader()
    reader.SetFileName(path)
    reader.Update()
    mesh = reader.GetOutput()
    if complaints.GetOutput():
        raise ValueError("VTK finds it damaged, or it holds no polygonal data")
    if not mesh.GetNumberOfPolys() or mesh.GetNumberOfStrips():
        raise ValueError("it holds no faces, or triangle strips (split them: pyvista's triangulate)")
    sides = np.diff(vtk_to_numpy(mesh.GetPolys().GetOffsetsArray()))
    if (sides != 3).any():
        bad = np.flatnonzero(sides != 3)[0]
        raise ValueError(f"face {bad} has {sides[bad]} corners, only triangles are read (triangulate the mesh)")
    faces = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    return vtk_to_numpy(mesh.GetPoints().GetData()), faces


if __name__ == "__main__":
    try:
        arrays = io.BytesIO()
        for array in read(sys.argv[1]):
            np.save(arrays, array)
    except ValueError as error:
        sys.stdout.write(str(error))
        sys.exit(1)
    sys.stdout.buffer.write(arrays.getvalue())
