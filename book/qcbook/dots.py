"""Measured rows as dots, one per pair of surfaces: a figure shows the spread beside the means."""

from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

COLOURS = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00"


def dot_lines(ax, rows, key, sets, crossed=lambda row: False):
    """Draw `key` of measured rows: a line per run, a dot per row, a bar at the mean of each set.

    `sets` maps names of sets to their labels; `crossed` says which rows are crosses. Runs stand in
    the order of the rows, from the top. Rows without the figure are left out.
    """
    runs = list(dict.fromkeys(row["run"] for row in rows))
    colours = dict(zip(sets, COLOURS))
    own = {name: [row for row in rows if row["set"] == name and row.get(key) is not None] for name in sets}
    for name, label in sets.items():
        ax.plot([], [], "o", color=colours[name], label=label)
    drawn = [name for name in sets if own[name]]
    for place, name in enumerate(drawn):
        shift = 0.8 * (place + 0.5) / len(drawn) - 0.4
        style = {"color": colours[name], "linestyle": ""}
        for marker, wanted in (("o", False), ("x", True)):
            some = [row for row in own[name] if crossed(row) == wanted]
            heights = [runs.index(row["run"]) + shift for row in some]
            ax.plot([row[key] for row in some], heights, marker=marker, ms=4, alpha=0.6, **style)
        for line, run in enumerate(runs):
            if values := [row[key] for row in own[name] if row["run"] == run]:
                ax.plot(sum(values) / len(values), line + shift, marker="|", ms=13, mew=2.5, **style)
    ax.set(yticks=range(len(runs)), yticklabels=runs, ylim=(len(runs) - 0.5, -0.5))
    ax.hlines([line - 0.5 for line in range(1, len(runs))], 0, 1, "0.8", transform=ax.get_yaxis_transform(), lw=0.8)


def plain_ticks(axis):
    """Ticks of a logarithmic axis as plain numbers: 0.5, 1, 2."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
