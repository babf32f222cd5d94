"""The floor: conformal alignment alone."""

from ...plane.mobius import mobius


def mobius_only(problem):
    """The disk Möbius map M that minimises `mean |M(p) - q|^2`: f = M(z), mu = 0.

    The only maps of the disk without distortion; what they leave of the landmark error is what the
    others work on.
    """
    return mobius(problem.disk.z, *problem.mobius)
