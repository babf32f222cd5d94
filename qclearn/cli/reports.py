"""`qclearn report`: finished registrations to a page that opens in any browser."""

import click

from .output import file_option, say


@click.command()
@click.argument("folders", nargs=-1, required=True, metavar="DIR...")
@file_option("HTML file to write; of several folders also a csv.")
def report(folders, out):
    """Write a page on the finished registrations in DIR..., folders that `qclearn register` wrote.

    Of one folder: the verdict, views before and after, a surface in 3-D, all figures. Of several,
    on one control: a line per subject, worst first, and the mean curvature. A page is one file and
    needs no network.
    """
    from ..reports import write_group, write_pair  # Matplotlib: only where it is used

    if len(folders) == 1:
        write_pair(folders[0], out)
    else:
        write_group(folders, out)
    say(f"written to {out}")
