"""Synthetic cortex: folded hemispheres with named sulci and a known dense correspondence."""

from .cortex import Cortex, CortexError, make_cortex

__all__ = ["Cortex", "CortexError", "make_cortex"]
