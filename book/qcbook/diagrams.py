"""Block diagrams of networks: boxes with words, arrows that end at their edges; and the shapes of
their outputs."""

TINTS = {"grey": "#EEEEEE", "blue": "#CFE5F3", "orange": "#F8D9C4", "green": "#CDEBDD"}


def block_diagram(ax, boxes, arrows):
    """Draw boxes, dict name -> (x, y, words, tint) in the units of the Axes, and arrows, pairs of
    names; the artists.

    A tint is one of `TINTS`. Returns (dict name -> Text, list of Annotation).
    """
    texts, lines = {}, []
    for name, (x, y, words, tint) in boxes.items():
        box = {"boxstyle": "round,pad=0.35", "fc": TINTS[tint], "ec": "0.4"}
        texts[name] = ax.text(x, y, words, ha="center", va="center", fontsize=9, zorder=2, bbox=box)
    across, up = zip(*(box[:2] for box in boxes.values()))
    ax.set(xlim=(min(across) - 0.6, max(across) + 0.6), ylim=(min(up) - 0.4, max(up) + 0.4))
    ax.axis("off")
    for start, end in arrows:
        # Above the words: they set the size of their boxes while they are drawn, and the arrow is
        # cut at these.
        ends = {"patchA": texts[start].get_bbox_patch(), "patchB": texts[end].get_bbox_patch()}
        look = {"arrowstyle": "->", "color": "0.4", "shrinkA": 1, "shrinkB": 1} | ends
        lines.append(ax.annotate("", boxes[end][:2], boxes[start][:2], zorder=4, arrowprops=look))
    return texts, lines


def output_shapes(parts, run):
    """A row (name, module, shape as text) per output of `parts`, pairs, during run()."""
    import torch  # here, as the diagrams need none

    rows = []

    def note(name):
        def hook(part, _, output):
            rows.append((name, part, " × ".join(map(str, output.shape[1:]))))

        return hook

    hooks = [part.register_forward_hook(note(name)) for name, part in parts]
    with torch.no_grad():
        run()
    for hook in hooks:
        hook.remove()
    return rows
