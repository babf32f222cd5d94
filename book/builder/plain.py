"""Executed pages as notebooks that any viewer reads (VS Code, Colab, GitHub): no directive, no
role, no label; numbers put in. The site offers them for download, and `make notebooks` writes the
same files to build/notebooks."""

import re
from collections import Counter, deque

from .readable import fold_hidden, outside_code, rewrite_tables, stored_values
from .references import shown

OPENING = re.compile(r"^(:{3,}|`{3,})\{([\w:-]+)\}[ \t]*(.*)$")
CODE_FENCE = re.compile(r"^(`{3,})\w*[ \t]*$")
SETTING = re.compile(r"^:([\w-]+):[ \t]*(.*)$")
EQUATION = re.compile(r"\$\$((?:(?!\$\$).)*)\$\$(?:[ \t]*\(([\w:-]+)\))?", re.DOTALL)
NUMBERED = (
    "theorem",
    "lemma",
    "proposition",
    "definition",
    "remark",
    "corollary",
    "example",
    "exercise",
    "table",
)
LABEL = re.compile(r"^\([\w:-]+\)=[ \t]*\n", re.MULTILINE)


def settings(lines):
    """Take the options, and the blank lines around them, from the lines below an opening fence."""
    found = {}
    while lines and (not lines[0].strip() or SETTING.match(lines[0])):
        if setting := SETTING.match(lines.popleft()):
            found[setting[1]] = setting[2]
    return found


class Flattened:
    """The text of one page without directives; counts as `references.numbered` does."""

    def __init__(self, chapter, targets):
        self.front, self.counts, self.targets = f"{chapter}." if chapter else "", Counter(), targets

    def number(self, kind):
        self.counts[kind] += 1
        return shown(kind, f"{self.front}{self.counts[kind]}")

    def heading(self, kind, argument, settings):
        """What stands in place of the opening line of a directive."""
        kind = kind.removeprefix("prf:")
        if kind in ("figure", "image"):
            picture = f"![{settings.get('alt', '')}]({argument})\n\n" if argument else ""
            return picture + (f"**{self.number(kind)}.** " if kind == "figure" else "")
        if kind == "proof":
            return "*Proof.*\n"
        if kind == "solution":
            return f"**Solution of {self.targets[argument].text if argument in self.targets else argument}**\n"
        if kind in NUMBERED:
            name = kind.capitalize() if "nonumber" in settings else self.number(kind)
            return f"**{name}**" + (f" ({argument})" if argument else "") + "\n"
        if kind in ("note", "tip", "warning", "important", "seealso"):
            return f"**{kind.capitalize()}**\n"
        return f"**{argument}**\n" if argument else ""

    def directives(self, text):
        """A bold line in place of the first line of a directive, nothing in place of its last; code
        goes through."""
        waiting, done, fences = deque(text.splitlines()), [], []
        while waiting:
            line = waiting.popleft()
            if fences and line.rstrip() == fences[-1]:
                done.append(line if fences.pop().startswith("`") else "")
            elif fences and fences[-1].startswith("`"):
                done.append(line)
            elif opening := OPENING.match(line):
                fences.append(opening[1])
                heading = self.heading(opening[2], opening[3].strip(), settings(waiting))
                if (
                    opening[2] == "figure" and waiting
                ):  # a caption goes on in the line of its number
                    waiting[0] = heading + waiting[0]
                else:
                    done.append(heading)
            elif fence := CODE_FENCE.match(line):
                fences.append(fence[1])
                done.append(line)
            else:
                done.append(line)
        return "\n".join(done)

    def equations(self, text):
        def tagged(match):
            if not match[2]:
                return match[0]
            number = self.number("equation").strip("()")
            return f"$${match[1].rstrip()}\n\\tag{{{number}}}\n$$"

        return LABEL.sub("", EQUATION.sub(tagged, text))

    def text(self, source):
        return self.directives(outside_code(self.equations, source)).strip() + "\n"


def for_plain_viewers(notebook, readable, chapter):
    """Change an executed page in place: values in place of {eval}, roles and directives as plain
    text, and a figure as its PNG alone, for not every viewer shows pictures within HTML."""
    flattened = Flattened(chapter, readable.targets)
    fold_hidden(notebook)
    rewrite_tables(notebook, readable)
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                output.data.pop("text/html", None)
        if cell.cell_type == "markdown":
            cell.source = flattened.text(readable.text(cell.source, stored_values(cell)))
            cell.metadata.pop("user_expressions", None)
    return notebook
