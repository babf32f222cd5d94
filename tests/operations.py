"""How many lines of Python a call runs: what grows with the size of a mesh is a loop, on machines of any speed."""

import sys


def lines_run(call):
    """The lines of Python that `call()` runs, those of the functions that it calls included."""
    counts = [0]

    def trace(frame, event, argument):
        counts[0] += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    finally:
        sys.settrace(before)
    return counts[0]
