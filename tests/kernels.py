"""The unit tests as other processors run them: with OpenBLAS's kernels for these (NumPy, SciPy and
cvxopt bring one each), without NumPy's, and with noise in every answer of the solver.

    python tests/kernels.py COMMAND ...     # `make test-kernels`; COMMAND runs the tests

Both libraries pass over a name that they do not know: before each run a process reads back what it got.
"""

import json
import os
import subprocess
import sys

READ = """
import json, cvxopt.cholmod, numpy._core._multiarray_umath as numpy, scipy.linalg, threadpoolctl
blas = [one["architecture"] for one in threadpoolctl.threadpool_info() if one["internal_api"] == "openblas"]
blas = ["Prescott" if name == "Katmai" else name for name in blas]  # two names of one set of kernels
print(json.dumps([blas, [name for name in numpy.__cpu_dispatch__ if numpy.__cpu_features__[name]]]))
"""
SWITCHES = [("OPENBLAS_CORETYPE", name) for name in ("Prescott", "Haswell", "SkylakeX")]
SWITCHES += [("NPY_DISABLE_CPU_FEATURES", "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"), ("QCLEARN_TEST_NOISE", "1e-12")]

ended = []
for name, value in SWITCHES:
    environment = os.environ | {name: value}
    asked = subprocess.run([sys.executable, "-c", READ], env=environment, stdout=subprocess.PIPE, check=True)
    kernels, features = json.loads(asked.stdout)
    told = f"{name}={value}: OpenBLAS with {kernels}, NumPy with {features}"
    if value == "SkylakeX" and "X86_V4" not in features:
        ended.append(f"left out, as this processor has no AVX-512: {told}")
        continue
    blas, numpy = name.startswith("OPENBLAS"), name.startswith("NPY")
    if (blas and (len(kernels) < 3 or {*kernels} != {value})) or (numpy and features):
        sys.exit(f"the switch did not take: {told}")
    # The command leaves out slow tests; of two expressions for -m the last one counts.
    rest = [] if blas or numpy else ["-m", "not slow and not digits"]
    failed = subprocess.call([*sys.argv[1:], *rest], env=environment)
    ended.append(f"{'failed' if failed else 'passed'}: {told}")
print(*ended, sep="\n")
sys.exit(any(line.startswith("failed") for line in ended))
