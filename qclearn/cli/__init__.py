"""The command line: `qclearn register`, `open`, `transfer`, `demo`, ...

Exit code 2: bad input, one line on stderr says what. Exit code 3: written, but suspect.
"""

import sys
import time
from importlib.metadata import version

import click

from . import group, landmarks, registration, reports, sphere, studies, surfaces
from .output import Command, expanded, fail, unfailing_streams


@unfailing_streams()
def main(arguments=None):
    """Run a command; bad input becomes one line on stderr and exit code 2."""
    try:
        given = [expanded(one) for one in (sys.argv[1:] if arguments is None else arguments)]
        command = Command(["qclearn", *given])
        # The process's time so far is that of Python's own start.
        command.begun = time.perf_counter() - (time.process_time() if arguments is None else 0)
        cli.main(given, prog_name="qclearn", standalone_mode=False, obj=command)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.Abort:
        fail("interrupted", 130)
    except click.ClickException as error:
        fail(f"{error.format_message()} (qclearn --help lists the commands)")
    except MemoryError:
        advice = "close other programs, use a machine with more, or coarser surfaces"
        fail(f"there is not enough memory for this; {advice}")
    # Our own errors are ValueErrors; a package of an extra may be missing.
    except (ValueError, OSError, ImportError) as error:
        of_system = isinstance(error, OSError) and error.filename
        fail(f"{of_system}: {error.strerror}; give another place" if of_system else str(error))


@click.group(no_args_is_help=False, context_settings={"show_default": True})
@click.version_option(version("qclearn"))
def cli():
    """Quasi-conformal registration of cortical surfaces."""


@click.command(
    hidden=True, context_settings={"ignore_unknown_options": True, "help_option_names": []}
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def grade(arguments):
    """Refuse the command of version 0.1 that graded hand-ins."""
    raise click.UsageError(
        "grade: nbgrader grades hand-ins now: `make course` writes its folder, and the guide for "
        "teachers (book/teaching.md) has the commands"
    )


COMMANDS = [landmarks.landmarks, registration.register, registration.demo, group.template]
COMMANDS += [reports.report, surfaces.open_command, surfaces.transfer, sphere.sphere]
COMMANDS += [surfaces.synth, studies.train, studies.benchmark, grade]
for command in COMMANDS:
    for option in command.params:
        # The reference asks each option; the group's own setting is for --help alone.
        if isinstance(option.default, (str, int, float)) and not isinstance(option.default, bool):
            option.show_default = True
    cli.add_command(command)
