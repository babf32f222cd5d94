"""Thresholds of a suspect registration, each beside what was measured (book/studies/suspect.py)."""

# Beside each threshold, from results/suspect.json: the range in good cases | with a mistake, which need not pass
# them all.
LIMITS = {
    "error_mm": 3.0,  # mean landmark error, mm, together with the next; 0.05 to 4.1 | 0.3 to 64
    "error_share": 1 / 3,  # of the error that the best Möbius map leaves; 0.003 to 0.34 | 0.037 to 1.2
    "curve_mm": 5.0,  # error of one curve, mm, together with the next; 0.06 to 8.2 | 0.3 to 95
    "curve_ratio": 5.0,  # times the error of the median curve; 1.0 to 5.8 | 1.0 to 9.2
    "rows": 0.005,  # rows switched, per vertex; 0 to 0.004 | 0 to 0.99
    "strong_mu": 0.9,  # what counts as strong distortion
    "strong_area": 0.01,  # share of the moving surface's area above that; 0 to 0.0013 | 0 to 0.70
    "better": 0.75,  # misfit of the curves concerned in another reading, over that as given; 1.2 to 44 | 0.013 to 0.34
    "plausible": 1.0,  # the same misfit over the curves' length in the disk; 0.18 to 10 | 0.028 to 0.44
    "surface_given": 0.33,  # misfit as given over that length, other surfaces or numbers; 0.013 to 0.78 | 0.55 to 3.9
    "hand": 0.1,  # gain of the folds' correlation if the moving side is mirrored; -0.63 to -0.22 | 0.18 to 0.53
    "decisive": 0.35,  # the same over that after a quarter or half turn more: below, folds judge no curve; 0.35 to 0.89
    "worse": 0.1,  # rise of the held-out curves' mean distance, with the next; -0.91 to 0.86 | -0.85 to 2.5
    "worse_mm": 0.5,  # the same in mm; -15 to 3.4 | -14 to 15
    "worse_curve_mm": 10.0,  # the same of one curve, with 0.1 of its distance before; -13 to 18 | -9.3 to 42
    "worse_dice": 0.05,  # loss of the annotations' Dice, as a share of it; -0.84 to 0.23 | -0.85 to 0.71
}
ROUNDING = 1e-9  # in the disk: a misfit of this size is none
