"""What a report of `register` holds, and what a picture of its page shows."""

import base64
import io

import numpy as np
from PIL import Image

KEYS = """
landmark_error_before landmark_error landmark_error_mm mean_abs_mu sd_abs_mu max_abs_mu flipped bijective
stopped units degenerate fallbacks seconds method alpha beta gamma delta eta start distortion features r
held_out_mm log2_area log2_shape mobius version suspect
"""
REPORT = set(KEYS.split())


def drawn(address):
    """Lightness (N,) and places (2, N), row and column, of what a picture shows, all of it within its rim."""
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(address.split(",")[1]))))
    shown = pixels[..., 3] > 0
    places = np.stack(np.nonzero(shown))
    assert not (shown[[0, -1]].any() or shown[:, [0, -1]].any())
    assert (np.ptp(places, axis=1) / shown.shape).max() > 0.95
    return pixels[shown, 0], places
