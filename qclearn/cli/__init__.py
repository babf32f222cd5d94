"""The command line: `qclearn register`, `open`, `transfer`, `demo`, ...

Exit code 2: bad input, one line on stderr says what. Exit code 3: written, but suspect.
"""

import signal
import sys
import time
import warnings
from importlib.metadata import version

import click

from ..moved import GONE, gone
from . import registration, reports, sphere, studies, surfaces
from .output import Word, expanded, fail, stop, warn


def main(arguments=None):
    """Run a command; bad input becomes one line on stderr and exit code 2."""
    given = sys.argv[1:] if arguments is None else arguments
    # The process's time so far is that of Python's own start.
    begun = time.perf_counter() - (time.process_time() if arguments is None else 0)
    if arguments is None:
        signal.signal(signal.SIGTERM, stop)
        if sys.stdout:  # a terminal without ö is no reason to fail
            sys.stdout.reconfigure(errors="backslashreplace")
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: warn(str(message))
        try:
            given = [expanded(one) for one in given]
            words = [(given[0], one.partition("=")[0]) for one in given if one.startswith("--")]
            if twice := [word for word in words if words.count(word) > 1 and word in ONCE]:
                raise click.UsageError(f"{twice[0][1]} is given twice; leave one out")
            made = ["qclearn", *given], begun
            cli.main(given, prog_name="qclearn", standalone_mode=False, obj=made)
        except click.exceptions.Exit as left:
            sys.exit(left.exit_code)
        except click.Abort:
            fail("interrupted", 130)
        except click.ClickException as error:
            # A command or an option that went has a line of its own.
            name = getattr(error, "option_name", None) or f"qclearn {''.join(given[:1])}"
            help = "(qclearn --help lists the commands)"
            fail(gone(name) if name in GONE else f"{error.format_message()} {help}")
        # Our own errors are ValueErrors; a package of an extra may be missing.
        except (ValueError, OSError, ImportError, MemoryError) as error:
            fail(str(error) or type(error).__name__)


@click.group(no_args_is_help=False, context_settings={"show_default": True})
@click.version_option(version("qclearn"))
def cli():
    """Quasi-conformal registration of cortical surfaces."""


COMMANDS = [registration.register, registration.demo, reports.report, surfaces.open_command]
COMMANDS += [surfaces.transfer, sphere.sphere, surfaces.synth, studies.train, studies.benchmark]
ONCE = set()  # commands with their options that stand once
for command in COMMANDS:
    for option in command.params:
        # The reference asks each option; the group's own setting is for --help alone.
        if isinstance(option.default, (str, int, float)) and not isinstance(option.default, bool):
            option.show_default = True
        if option.type is click.STRING:
            option.type = Word()
        if not option.multiple:
            ONCE |= {(command.name, name) for name in option.opts}
    cli.add_command(command)
