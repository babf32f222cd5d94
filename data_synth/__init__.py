"""Synthetic cortex: folded hemispheres with named sulci and a known dense correspondence."""

from .cohort import CohortWarning, cohort
from .correspondence import correspondence
from .cortex import Cortex, CortexError, make_cortex
from .subjects import load_cortex, save_cortex
from .template import SULCI

SULCUS_NAMES = tuple(SULCI)

__all__ = [
    "SULCUS_NAMES", "CohortWarning", "Cortex", "CortexError", "cohort", "correspondence", "load_cortex", "make_cortex",
    "save_cortex",
]  # fmt: skip
