"""Measured rows as dots: a figure shows the spread over pairs of surfaces beside the means."""

from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

# What the tables of "Should I use this?" translate: a run's key in files -> the name of its setting on every page.
SETTINGS = {"landmark-free": "folds alone", "hybrid": "folds and curves", "Gauss-Newton": "landmarks alone"}
COLOURS = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00"

# Words of a run's name -> colour, marker, label of its family; the first one counts.
FAMILIES = {
    "harmonic": ("#D55E00", "s", "harmonic maps"),
    "Gauss-Newton": ("#0072B2", "o", "landmarks alone"),
    "paper's networks": ("#CC79A7", "v", "the paper's networks, corrected"),
    "CP-Net": ("#009E73", "^", "CP-Net and what follows it"),
    "": ("0.35", "D", "others"),
}


def setting(run):
    """A run's name on a page: 'Gauss-Newton, sliding' is 'landmarks alone, sliding'."""
    key, comma, rest = run.partition(",") if "(" not in run else run.partition(" (")
    return SETTINGS.get(key, key) + (comma + rest).replace("1e5", "10⁵").replace("1e4", "10⁴")


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
    ax.set(yticks=range(len(runs)), yticklabels=map(setting, runs), ylim=(len(runs) - 0.5, -0.5))
    ax.hlines([line - 0.5 for line in range(1, len(runs))], 0, 1, "0.8", transform=ax.get_yaxis_transform(), lw=0.8)


def run_dots(ax, found, rows, x, y, floor=0):
    """Draw each run of a summary `found` at its (x, y), and a line over the y of its `rows`.

    A hollow dot is a run with a map that is not certified. What lies below `floor` is drawn there.
    """
    left = dict(found)
    for word, (color, marker, label) in FAMILIES.items():
        own = {name: left.pop(name) for name in list(left) if word in name}
        for name, line in own.items():
            values = [row[y] for row in rows if row["run"] == name and row.get(y) is not None]
            ends = [max(floor, value) for value in (min(values), max(values))]
            ax.plot([line[x]] * 2, ends, color=color, linewidth=0.8, alpha=0.5)
            face = color if line["certified"] == line["pairs"] else "white"
            ax.plot(line[x], max(floor, line[y]), marker, color=color, markerfacecolor=face, zorder=3 if word else 2)
        ax.plot([], [], marker, color=color, label=label)


def plain_ticks(axis):
    """Ticks of a logarithmic axis as plain numbers: 0.5, 1, 2."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
