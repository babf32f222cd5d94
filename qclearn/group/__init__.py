"""Templates: subjects registered to their mean, round after round, on many workers."""
