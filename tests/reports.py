"""What a report of `register` holds."""

KEYS = """
landmark_error_before landmark_error landmark_error_mm mean_abs_mu sd_abs_mu max_abs_mu flipped bijective
stopped units degenerate fallbacks seconds method alpha beta gamma delta eta start distortion features r
held_out_mm log2_area log2_shape mobius version suspect
"""
REPORT = set(KEYS.split())
