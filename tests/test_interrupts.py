"""An interrupt while packages are imported comes after them, and the session goes on."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from qclearn.interrupts import signals_wait

# Each call is interrupted while a package imports one of its modules, and then made again.
PROGRAM = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background has none
class Interrupting:
    name = None
    def find_spec(self, name, *_):
        if name == self.name:
            self.name = None
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, finder := Interrupting())
import qclearn as qc
def depth():
    from meshes import bowl
    return qc.sulcal_depth(bowl(0.9, 8))
for name, call in {"cvxopt.base": lambda: qc.Surface, "pyvista.core": depth}.items():
    finder.name = name
    try:
        call()
    except KeyboardInterrupt:
        print(name, name in sys.modules and name.split(".")[0] in sys.modules)
    call()
"""


def test_a_session_goes_on_after_an_interrupt_of_its_first_imports():
    options = {"env": {"PYTHONPATH": ":".join(sys.path)}, "cwd": Path(__file__).parent}
    made = subprocess.run([sys.executable, "-c", PROGRAM], **options, capture_output=True, text=True, check=False)
    assert made.stdout.splitlines() == ["cvxopt.base True", "pyvista.core True"], made.stderr


def test_what_a_signal_does_and_an_error_come_after_the_block():
    before, done = signal.signal(signal.SIGINT, signal.default_int_handler), []
    with pytest.raises(KeyboardInterrupt), signals_wait():
        signal.raise_signal(signal.SIGINT)
        done.append("whole")
    assert done and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)
    with pytest.raises(ImportError), signals_wait():
        raise ImportError
