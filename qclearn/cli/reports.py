"""`qclearn report`: a finished registration to a page that opens in any browser."""

import click

from ..moved import gone
from .output import file_option, say


@click.command()
@click.argument("folders", nargs=-1, required=True, metavar="DIR")
@file_option("HTML file to write.")
def report(folders, out):
    """Write a page on the finished registration in DIR, a folder that `qclearn register` wrote.

    The verdict, views before and after, a surface in 3-D, all figures. A page is one file and needs
    no network.
    """
    from ..reports import write_pair  # Matplotlib: only where it is used

    if len(folders) > 1:
        raise click.UsageError(gone("qclearn report FOLDER FOLDER"))
    write_pair(folders[0], out)
    say(f"written to {out}")
