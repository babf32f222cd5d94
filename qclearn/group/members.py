"""The subjects of a group: surfaces of one side with their features, checked and sorted."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..io.safe import naming
from ..registration.features import FOLDS, FeatureError, check_values
from ..surfaces.surface import Surface, SurfaceError, require_disk, require_outward
from ..surfaces.units import other_units

# Attributes of synthetic subjects that all of a group share.
TRAITS = ("hemisphere", "generation")


class TemplateError(ValueError):
    """A group that has no template, or a folder of another group: says why and what to do."""


@dataclass(frozen=True, eq=False)
class Member:
    """A subject: name, surface, own maps (feature -> (V,)), and as key a hash of both."""

    name: str
    surface: Surface
    given: dict
    key: str


def members_of(subjects, features):
    """The `Member`s, sorted by key, and the features' names.

    TemplateError, FeatureError or SurfaceError, with the subject's name, where one cannot be used.
    """
    named = check_subjects(subjects)
    seen = {}
    for name, surface in named:
        twin = seen.setdefault(surface.fingerprint["sha256"], name)
        if twin != name:
            message = f"{twin} and {name} are one surface, which would count twice"
            raise TemplateError(f"{message}; leave one of them out")
    names, maps = check_features(features, named)
    members = [
        Member(name, surface, given, key_of(surface, given))
        for (name, surface), given in zip(named, maps)
    ]
    return sorted(members, key=lambda member: member.key), names


def check_subjects(subjects):
    """Pairs (name, surface) of a dict or a list of surfaces, or of subjects that have one."""
    if not isinstance(subjects, (Mapping, list, tuple)):
        raise TemplateError(
            f"subjects are {subjects!r:.60}: give a list of surfaces, or a dict of them by name"
        )
    if not isinstance(subjects, Mapping):
        subjects = {f"subject {number}": subject for number, subject in enumerate(subjects, 1)}
    if len(subjects) < 2:
        raise TemplateError(
            f"{len(subjects)} subjects: a template is what several have in common; give at least "
            "two"
        )
    for trait in TRAITS:
        with_trait = [name for name, subject in subjects.items() if hasattr(subject, trait)]
        check_trait(trait, {name: getattr(subjects[name], trait) for name in with_trait})
    named = [(str(name), getattr(one, "surface", one)) for name, one in subjects.items()]
    for name, surface in named:
        if not isinstance(surface, Surface):
            raise TemplateError(
                f"{name}: {surface!r:.60} is no Surface; read files with read_surface first"
            )
        for reason in other_units(**{name: surface}):
            raise SurfaceError(reason)
        with naming(name):
            require_disk(surface)
            require_outward(surface)
    return named


def check_trait(trait, values):
    """TemplateError unless all values of a trait (dict name -> value) are the same."""
    first = next(iter(values), None)
    for name, value in values.items():
        if value != values[first]:
            both = f"{first}: {values[first]}, {name}: {value}"
            raise TemplateError(f"subjects of more than one {trait} ({both}); give those of one")


def check_features(features, named):
    """The features' names, and for each subject its own maps, dict."""
    if not isinstance(features, (list, tuple)) or not features:
        raise FeatureError(
            f"features are {features!r}: give a list of them, {' and '.join(FOLDS)} for instance"
        )
    names = []
    maps = [{} for _ in named]
    for given in features:
        if isinstance(given, str):
            if given not in FOLDS:
                known = f"{' and '.join(FOLDS)} are computed, others (name, arrays)"
                raise FeatureError(f"unknown feature {given!r}: {known}")
            names.append(given)
            continue
        is_pair = isinstance(given, (list, tuple)) and len(given) == 2
        name, arrays = given if is_pair else (None, None)
        is_list = isinstance(arrays, (list, tuple)) and len(arrays) == len(named)
        if not isinstance(name, str) or not is_list:
            wanted = f"give a name and a list of {len(named)} arrays, one a subject"
            raise FeatureError(f"feature {given!r:.60}: {wanted}")
        names.append(name)
        for own, values, (subject, surface) in zip(maps, arrays, named):
            own[name] = check_values(values, f"{name}, {subject}", surface)
    if len(set(names)) < len(names):
        raise FeatureError(f"features named twice among {names}; rename or drop one of each")
    return names, maps


def key_of(surface, given):
    """A hash of a subject's surface and of its own maps."""
    digest = hashlib.sha256(surface.fingerprint["sha256"].encode())
    for name in sorted(given):
        digest.update(name.encode() + np.ascontiguousarray(given[name], "<f8").tobytes())
    return digest.hexdigest()[:24]
