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
    came, answers = [], {}
    if threading.current_thread() is threading.main_thread():
        found = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
        answers = {number: answer for number, answer in found.items() if callable(answer)}
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
    """`lazy_loader.attach`, whose imports are whole: __getattr__, __dir__ and __all__ of a package.

    table: its modules, dict of the names that each brings.
    """
    found, *names = lazy_loader.attach(package, submod_attrs=table)
    return signals_wait()(found), *names
