"""The command line: `qclearn register`, `open`, `transfer`, `demo`, ...

One line on stderr and exit code 2 for bad input; exit code 3 for a registration that is written,
but suspect.
"""

import sys
import time
from importlib.metadata import version

import click

from . import group, landmarks, registration, reports, sphere, studies, surfaces
from .output import Command, fail


def main(arguments=None):
    """Run a command; bad input becomes one line on stderr and exit code 2."""
    try:
        command = Command(["qclearn", *(sys.argv[1:] if arguments is None else arguments)])
        # Python's own start.
        command.begun = time.perf_counter() - (time.process_time() if arguments is None else 0)
        cli.main(arguments, prog_name="qclearn", standalone_mode=False, obj=command)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.Abort:
        fail("interrupted", 130)
    except click.ClickException as error:
        fail(f"{error.format_message()} (qclearn --help lists the commands)")
    except MemoryError:
        fail(
            "there is not enough memory for this; close other programs, use a machine with more, "
            "or coarser surfaces"
        )
    except (
        ValueError,
        OSError,
        ImportError,
    ) as error:  # ours are ValueErrors; torch may be missing
        fail(str(error))


@click.group(no_args_is_help=False)
@click.version_option(version("qclearn"))
def cli():
    """Quasi-conformal registration of cortical surfaces."""


@click.command(
    hidden=True, add_help_option=False, context_settings={"ignore_unknown_options": True}
)
@click.argument("words", nargs=-1, type=click.UNPROCESSED)
def grade(words):
    """Version 0.1 graded hand-ins by itself."""
    raise click.UsageError(
        "grade: nbgrader grades hand-ins now: `make course` writes its folder, and the guide for "
        "teachers"
        " (book/teaching.md) has the commands"
    )


for command in (
    landmarks.landmarks,
    registration.register,
    registration.demo,
    group.template,
    reports.report,
    surfaces.open_command,
    surfaces.transfer,
    sphere.sphere,
    surfaces.synth,
    studies.train,
    studies.benchmark,
    grade,
):
    cli.add_command(command)
