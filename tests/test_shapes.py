"""The shapes of the public functions: none is missing, and what the tests hold them to does refuse."""

import inspect
from typing import get_args, get_type_hints

import numpy as np
import pytest
from jaxtyping import AbstractArray
from numpy import ndarray
from scipy import sparse

import qclearn as qc
from shapes import ShapeError, members_of

PUBLIC = [getattr(qc, name) for name in qc.__all__]


def functions_of(public):
    """Pairs (name, function): a function itself, or what a class offers, its making included."""
    if inspect.isfunction(public):
        yield public.__name__, public
    elif not issubclass(public, Exception):
        for _, name, member in members_of(public):
            member = getattr(member, "fget", None) or getattr(member, "func", member)
            if inspect.isfunction(member) and (name == "__init__" or not name.startswith("_")):
                yield f"{public.__name__}.{name}", member


FUNCTIONS = dict(pair for public in PUBLIC for pair in functions_of(public))


def parts(hint):
    """An annotation and all that it is made of."""
    yield hint
    for inner in get_args(hint):
        yield from parts(inner)


def without_shape(hint):
    """Whether an annotation has an array in it of which nothing says the shape."""
    return any(part in (ndarray, np.generic) or is_sparse(part) for part in parts(hint))


def is_sparse(part):
    return inspect.isclass(part) and issubclass(part, sparse.sparray) and not issubclass(part, AbstractArray)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_and_result_is_annotated_and_every_array_has_a_shape(name):
    function = FUNCTIONS[name]
    hints = get_type_hints(function)
    expected = set(inspect.signature(function).parameters) - {"self"} | (
        {"return"} if "__init__" not in name else set()
    )
    assert set(hints) >= expected
    assert [key for key, hint in hints.items() if without_shape(hint)] == []


@pytest.mark.parametrize("cls", [public for public in PUBLIC if inspect.isclass(public)])
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
