"""What the two fuzzers share: options, a case in a forked process under limits of time and memory,
and the count of verdicts."""

import argparse
import json
import os
import resource
import signal
import sys
import time
from collections import Counter
from pathlib import Path


def read_options(program, kinds):
    """The options of a fuzzer; program: its docstring."""
    parser = argparse.ArgumentParser(description=program, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=kinds)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path(os.devnull), help="a line of JSON for each case")
    return parser.parse_args()


def forked(work, answer, seconds, addresses):
    """What `work()` returns, (verdict, text), by way of the file `answer`; ("hang", "") or
    ("crash", "") without it."""
    answer.unlink(missing_ok=True)  # an earlier case's
    child = os.fork()
    if not child:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_AS, (addresses, addresses))
        answer.write_text(json.dumps(work()))
        os._exit(0)
    end = time.monotonic() + seconds
    while os.waitpid(child, os.WNOHANG)[0] == 0:
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return "hang", ""
        time.sleep(0.002)
    return tuple(json.loads(answer.read_text())) if answer.exists() else ("crash", "")


def tally(found, faults, out):
    """Write every (label, verdict, text) as a line of JSON, show the faults, and exit with 1 if
    there are any."""
    count = Counter()
    with out.open("w", encoding="utf-8") as rows:
        for label, verdict, text in found:
            count[verdict] += 1
            rows.write(json.dumps([label, verdict, text[:300]]) + "\n")
            if verdict in faults:
                print(label, verdict, text[:300], flush=True)
    print(dict(count))
    sys.exit(bool(faults & set(count)))
