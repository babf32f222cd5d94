"""The shapes of the public functions: none is missing, and what the tests hold them to does refuse."""

import inspect
from typing import get_args, get_type_hints

import numpy as np
import pytest
from jaxtyping import AbstractArray
from numpy import ndarray
from scipy import sparse

import qclearn as qc
from shapes import ShapeError, functions_of

PUBLIC = [getattr(qc, name) for name in qc.__all__]


CLASSES = [public for public in PUBLIC if inspect.isclass(public)]
METHODS = {
    f"{cls.__name__}.{name}": function
    for cls in CLASSES
    for _, name, _, function in functions_of(cls)
    if not issubclass(cls, Exception)
}
FUNCTIONS = METHODS | {public.__name__: public for public in PUBLIC if inspect.isfunction(public)}


def without_shape(hint):
    """Whether an annotation, or a part of it, is an array of which nothing says the shape."""
    bare = inspect.isclass(hint) and issubclass(hint, sparse.sparray) and not issubclass(hint, AbstractArray)
    return bare or hint in (ndarray, np.generic) or any(map(without_shape, get_args(hint)))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_and_result_is_annotated_and_every_array_has_a_shape(name):
    function = FUNCTIONS[name]
    hints = get_type_hints(function)
    expected = {*inspect.signature(function).parameters, "return"}
    assert set(hints) >= expected - {"self", "return" if "__init__" in name else ""}
    assert [key for key, hint in hints.items() if without_shape(hint)] == []


@pytest.mark.parametrize("cls", CLASSES)
def test_every_array_of_a_public_class_has_a_shape(cls):
    assert [name for name, hint in get_type_hints(cls).items() if without_shape(hint)] == []


def test_the_public_functions_are_held_to_their_shapes():
    """Wherever they are in hand; and the library's own refusal comes first."""
    from qclearn.plane import Disk, beltrami, solver

    z, faces = qc.polar_disk(2, 6)
    assert qc.locate is beltrami.locate and qc.mobius is solver.mobius
    with pytest.raises(ShapeError, match="compose_coefficients takes mu_g"):
        qc.compose_coefficients(np.zeros(3, complex), np.ones(3, complex), np.zeros((2, 3), complex))
    assert hasattr(qc.BeltramiDiskSolver.solve, "__wrapped__") and hasattr(Disk.interpolation, "__wrapped__")
    with pytest.raises(qc.BeltramiError, match="give complex numbers"):
        qc.signed_areas(np.stack([z, z]), faces)
