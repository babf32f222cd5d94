"""Imports that no signal cuts short."""

import signal
import threading
from contextlib import contextmanager

import lazy_loader


@contextmanager
def signals_wait():
    """Signals that Python code answers, as by a KeyboardInterrupt, come after the block.

    For imports of compiled packages where they are first used: one that an exception ends (VTK
    makes an ImportError of it) fails for the rest of the session.
    """
    came, here = [], threading.current_thread() is threading.main_thread()
    found = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    answers = {number: answer for number, answer in found.items() if here and callable(answer)}
    for number in answers:
        signal.signal(number, lambda *given: came.append(given))
    try:
        yield
    finally:
        for number, answer in answers.items():
            signal.signal(number, answer)
        for number, frame in came:
            answers[number](number, frame)


def attach(package, table):
    """`lazy_loader.attach` of a package's table, module -> names, with imports that are whole."""
    modules = {module: names.split() for module, names in table.items()}
    found, *names = lazy_loader.attach(package, submod_attrs=modules)
    return signals_wait()(found), *names
