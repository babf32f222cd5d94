"""The shapes that the public functions are annotated with, held to whenever a test calls one of them.

Whatever NumPy takes for such an array counts as one, and numbers of a narrower kind too. What an annotation does not
admit, the library has to refuse itself: a call that comes back is a ShapeError, as is a result of another shape.
"""

import inspect
import sys
from collections.abc import Mapping
from functools import cached_property, wraps
from typing import get_type_hints

import numpy as np
from beartype import BeartypeConf
from beartype.door import is_bearable
from jaxtyping import jaxtyped

NUMBERS = BeartypeConf(is_pep484_tower=True)  # integers are real numbers, real numbers complex ones


class ShapeError(AssertionError):
    """An argument or a result that is not what the annotation says."""


def readings(value):
    """What a value may be taken for: itself, an array, and an array of a wider kind of numbers."""
    yield value
    if isinstance(value, Mapping):
        yield {name: np.asarray(item) for name, item in value.items()}
    elif not isinstance(value, str | None) and np.ndim(value):
        array = np.asarray(value)
        yield array
        yield from (array.astype(wider) for wider in (float, complex) if array.dtype.kind in "iuf")
    elif isinstance(value, int | float | complex | np.generic):
        yield from (np.asarray(value, wider) for wider in (float, complex) if not np.iscomplexobj(value))
        yield np.asarray(value)
        yield value.item() if isinstance(value, np.generic) else value


def admits(hint, value):
    """Whether the value is what the annotation says, in the dimensions bound so far."""
    try:
        return any(is_bearable(reading, hint, conf=NUMBERS) for reading in readings(value))
    except ValueError:  # rows of unequal lengths
        return False


def kind(value):
    """All that an annotation can say of a value, or of a collection's items: type, kind of numbers and shape."""
    if isinstance(value, tuple | list):
        return type(value), tuple(map(kind, value))
    if isinstance(value, Mapping):
        return type(value), tuple((name, kind(item)) for name, item in value.items())
    return type(value), getattr(value, "dtype", None), getattr(value, "shape", None)


def held(function):
    """The function with arguments and result held to its annotations; each kind of call is judged once."""
    signature, hints, right = inspect.signature(function), get_type_hints(function), set()
    result_hint = hints.pop("return", None)
    for parameter in signature.parameters.values():
        if parameter.kind is inspect.Parameter.VAR_POSITIONAL and parameter.name in hints:
            hints[parameter.name] = tuple[hints[parameter.name], ...]

    @wraps(function)
    def call(*args, **kwargs):
        result = function(*args, **kwargs)
        asked = kind((args, kwargs, result))
        if asked not in right:
            judge(args, kwargs, result)
            right.add(asked)
        return result

    def judge(args, kwargs, result):
        with jaxtyped("context"):
            given = signature.bind(*args, **kwargs).arguments
            wrong = [name for name, value in given.items() if name in hints and not admits(hints[name], value)]
            if wrong:
                raise ShapeError(f"{function.__qualname__} takes {', '.join(wrong)} that its annotations exclude")
            if result_hint is not None and not admits(result_hint, result):
                raise ShapeError(f"{function.__qualname__} returns {result!r}, which is not {result_hint}")

    return call


def functions_of(cls):
    """What a class and those that it inherits from, all of one package, offer, its making included:
    (class, name, member, the member's function), its own last."""
    house, found = cls.__module__.split(".")[0], []
    for owner in reversed(cls.__mro__):
        if owner.__module__.split(".")[0] == house:
            for name, member in vars(owner).items():
                function = getattr(member, "fget", None) or getattr(member, "func", member)
                if inspect.isfunction(function) and (name == "__init__" or not name.startswith("_")):
                    found.append((owner, name, member, function))
    return found


def hold_class(cls):
    """A class with its making and its public methods held to their annotations, inherited ones too."""
    for owner, name, member, function in functions_of(cls):
        if isinstance(member, cached_property):
            member.func = held(function)
        else:
            setattr(owner, name, property(held(function)) if isinstance(member, property) else held(function))


def hold(package):
    """Hold all that `package.__all__` names to its annotations, wherever its modules have it in hand."""
    offered = [getattr(package, name) for name in package.__all__]  # first: this loads the modules
    modules = [module for name, module in sys.modules.items() if name.split(".")[0] == package.__name__]
    for public in offered:
        if inspect.isfunction(public):
            checked = held(public)
            for module in modules:
                for name in [name for name, value in vars(module).items() if value is public]:
                    setattr(module, name, checked)
        elif not issubclass(public, Exception):
            hold_class(public)
