"""What a report of `register` holds."""

REPORT = {
    "landmark_error_before",
    "landmark_error",
    "landmark_error_mm",
    "mean_abs_mu",
    "sd_abs_mu",
    "max_abs_mu",
    "flipped",
    "bijective",
    "degenerate",
    "fallbacks",
    "seconds",
    "method",
    "alpha",
    "beta",
    "gamma",
    "mobius",
    "version",
    "suspect",
}
