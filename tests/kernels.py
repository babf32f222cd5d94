"""The unit tests as other processors run them: with OpenBLAS's kernels for these, without NumPy's, and
with noise in every answer of the solver.

    python tests/kernels.py COMMAND ...     # `make test-kernels`; COMMAND runs the tests

Before each run a process reads back what it got, as both libraries pass over a name that they do not
know. NumPy, SciPy and cvxopt bring an OpenBLAS each, and all three must have switched.
"""

import json
import os
import subprocess
import sys

READ = """
import json, cvxopt.cholmod, numpy._core._multiarray_umath as numpy, scipy.linalg, threadpoolctl
libraries = [one for one in threadpoolctl.threadpool_info() if one["internal_api"] == "openblas"]
kept = [name for name in numpy.__cpu_dispatch__ if numpy.__cpu_features__[name]]
print(json.dumps([[one["architecture"] for one in libraries], kept]))
"""
SWITCHES = [("OPENBLAS_CORETYPE", name) for name in ("Prescott", "Haswell", "SkylakeX")]
SWITCHES += [("NPY_DISABLE_CPU_FEATURES", "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"), ("QCLEARN_TEST_NOISE", "1e-12")]
SAME = {"Katmai": "Prescott"}  # two names of one set of kernels


def main(command):
    ended = {}
    for name, value in SWITCHES:
        environment = os.environ | {name: value}
        asked = subprocess.run([sys.executable, "-c", READ], env=environment, stdout=subprocess.PIPE, check=True)
        kernels, features = json.loads(asked.stdout)
        kernels = [SAME.get(kernel, kernel) for kernel in kernels]
        if value == "SkylakeX" and "X86_V4" not in features:
            ended[value] = "left out: this processor has no AVX-512"
            continue
        told = f"{name}={value}: OpenBLAS with {kernels}, NumPy with {features}"
        blas, numpy = name.startswith("OPENBLAS"), name.startswith("NPY")
        if (blas and (len(kernels) < 3 or {*kernels} != {value})) or (numpy and features):
            sys.exit(f"the switch did not take: {told}")
        print(f"\n{told}", flush=True)
        # The command says already that slow tests are left out; the last word counts.
        rest = [] if blas or numpy else ["-m", "not slow and not digits"]
        failed = subprocess.call([*command, *rest], env=environment)
        ended[value] = "failed" if failed else "passed"
    print("", *(f"{value}: {end}" for value, end in ended.items()), sep="\n")
    return "failed" in ended.values()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
