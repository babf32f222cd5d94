"""Synthetic cortex: folded hemispheres with named sulci and a known dense correspondence."""

from qclearn.files.extras import require

with require("synth", "synthetic surfaces"):
    from data_synth.cohort import CohortWarning, cohort
    from data_synth.correspondence import correspondence
    from data_synth.cortex import Cortex, CortexError, growth_frames, make_cortex
    from data_synth.subjects import load_cortex, save_cortex
    from data_synth.template import SULCI

SULCUS_NAMES = tuple(SULCI)

__all__ = [
    "SULCUS_NAMES", "CohortWarning", "Cortex", "CortexError", "cohort", "correspondence", "growth_frames",
    "load_cortex", "make_cortex", "save_cortex",
]  # fmt: skip
