"""Programs that measure what `qclearn/benchmark/results/` holds."""
