"""Each term of the glossary is a link where the book first uses it; the page on notation has the book's symbols."""

import re
from collections import defaultdict
from pathlib import Path

from book.builder.references import CODE, chapters, markdown_of

ROOT = Path(__file__).resolve().parents[2]

ENTRY = re.compile(r"^\(term-([\w-]+)\)=\n\*\*([^*]+)\*\*((?:, \*[^*]+\*)*):", re.MULTILINE)
TEXTS = {page: markdown_of(page) for page in chapters()}
READ = [page for page in TEXTS if page not in ("glossary", "bibliography")]
BLANKED = [
    re.compile(pattern, re.MULTILINE | re.DOTALL)
    for pattern in (
        CODE.pattern,
        r"^(:{3,})\{(?:figure|image|math|bibliography)\}.*?^\1[ \t]*$",
        r"\$\$.*?\$\$",
        r"(?<!\\)\$[^$]+\$",
        r"\{[\w:-]+\}(`+).*?\1",
        r"(`+)(?!\{).*?\1",
        r"^:{3,}\{[^\n]*$",
        r"^:[\w-]+:[^\n]*$",
        r"^#+ [^\n]*$",
        r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]\((?!#term-)[^)\s]*\)",
        r"(?<=\]\()(?!#term-)[^)\s]*(?=\))",
    )
]
LINK = re.compile(r"\[([^\[\]]+)\]\(#term-([\w-]+)\)")


def forms():
    """form in small letters -> name of the term; a form ends in s or es, too."""
    found = {}
    for name, term, others in ENTRY.findall(TEXTS["glossary"]):
        for form in [term, *re.findall(r"\*([^*]+)\*", others)]:
            found[form.lower()] = name
    return found


def pattern_of(found):
    alternatives = "|".join(re.escape(form).replace(r"\ ", r"\s+") for form in sorted(found, key=len, reverse=True))
    return re.compile(rf"(?<![\w-])({alternatives})(?:e?s)?(?![\w-])", re.IGNORECASE)


def prose_of(text):
    """The text with spaces for all that is not prose: places stay."""
    for pattern in BLANKED:
        text = pattern.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    return text


def uses(text, found, pattern):
    """(words, name of the term, name that its link leads to or None) in the order of the text."""
    prose = prose_of(text)
    links = {match.start(1) + i: match[2] for match in LINK.finditer(prose) for i in range(len(match[1]))}
    prose = LINK.sub(lambda match: f" {match[1]}".ljust(len(match[0])), prose)
    for match in pattern.finditer(prose):
        yield match[0], found[" ".join(match[1].lower().split())], links.get(match.start())


def first_uses():
    """name of a term -> (page, words, name that the link leads to or None)."""
    found, first = forms(), {}
    pattern = pattern_of(found)
    for page in READ:
        for words, name, link in uses(TEXTS[page], found, pattern):
            first.setdefault(name, (page, words, link))
    return first


def test_the_glossary_is_long_and_in_order():
    names = [term for _, term, _ in ENTRY.findall(TEXTS["glossary"])]
    assert len(names) >= 60
    assert TEXTS["glossary"].count("(term-") == len(names) == len(set(forms().values()))
    order = [name.lower().replace("ö", "o").replace("-", " ") for name in names]
    assert order == sorted(order)


def test_each_term_is_linked_at_its_first_use():
    first = first_uses()
    assert set(forms().values()) - set(first) == set(), "terms that the book never uses"
    unlinked = {name: f"{page}: {words}" for name, (page, words, link) in first.items() if link != name}
    assert unlinked == {}, "link the words to (#term-...) there"


def test_links_to_the_glossary_lead_to_a_term():
    names = set(forms().values())
    assert {name for page in TEXTS for _, name in LINK.findall(TEXTS[page])} <= names


# What is layout or the common language of mathematics; every other name and every letter is a symbol.
COMMON = re.compile(
    r"\\(?:left|right|[bB]ig[lr]?|[dt]?frac|q?quad|text|math(?:rm|bf)|operatorname|begin|end|[cl]?dots?|times|sum|int|prod|sqrt"
    r"|cos|sin|tanh?|cot|exp|log|ln|max|min|arg|det|pm|leq?|geq?|ne|in|ni|to|mapsto|sim|approx|propto|[lr][vV]ert|underbrace"
    r"|overline|nobreak|(?:Long)?[rR]ightarrow)"
)
MATHEMATICS = re.compile(r"\$\$(.*?)\$\$|(?<![\\$])\$([^$]+)\$", re.DOTALL)
WORDS = re.compile(r"\\(?:text|mathrm|operatorname|begin|end)\*?\s*\{[^{}]*\}")
SYMBOL = re.compile(r"\\(?:mathcal|mathbb|mathsf)\s*\{?[A-Za-z]\}?|f_z|f_\{\\bar z\}|\\[A-Za-z]+|[A-Za-z]")


def symbols(text):
    """Letters and names of a page's formulas: {'\\mu', 'f', 'f_z', '\\mathcal L', ...}."""
    text = re.sub(r"\{eval\}(`+).*?\1|(`+)(?!\{)[^\n]*?\2", " ", CODE.sub("", text), flags=re.DOTALL)
    formulas = " ".join(display or inline for display, inline in MATHEMATICS.findall(text))
    found = SYMBOL.findall(WORDS.sub(" ", formulas))
    found = {re.sub(r"^(\\math\w+)\s*\{?(\w)\}?$", r"\1 \2", symbol) for symbol in found}
    return {symbol for symbol in found if not COMMON.fullmatch(symbol)}


def test_the_page_on_notation_has_every_symbol_of_three_pages():
    pages = defaultdict(set)
    for page in set(READ) - {"notation"}:
        for symbol in symbols(TEXTS[page]):
            pages[symbol].add(page)
    explained = symbols(" ".join(line.split("|")[1] for line in TEXTS["notation"].splitlines() if line.startswith("|")))
    missing = {symbol: sorted(where) for symbol, where in pages.items() if len(where) >= 3 and symbol not in explained}
    assert missing == {}, "put them into the first column of a table there"


QUOTING = {"lbs", "dbsnet", "linebyline", "notation"}  # pages with formulas of the paper, in its letters
FORMULA = re.compile(r"\$\$.*?\$\$|(?<!\\)\$[^$\n]+\$", re.DOTALL)
NAMES = re.compile(r"\\(?:operatorname|mathrm|text|math\w+|begin|end)\s*(?:\{[^}]*\}|\w)|\\[a-zA-Z]+")
INDEX = re.compile(r"_\s*(?:\{[^}]*\}|\w)")
STRAY = re.compile(r"(?<![a-zA-Z])(?:[bc]|d(?!\}\{d|\|))(?![a-zA-Z])")


def strays(text):
    """Formulas in which b is no index, d no differential, c at all, or M, the number of landmarks, has an index."""
    for formula in FORMULA.findall(text):
        named = NAMES.sub(lambda match: "x" * len(match[0]), formula)
        alone = STRAY.search(INDEX.sub("", named)) and formula != "$b$"  # which says what the index means
        if alone or re.search(r"(?<![a-zA-Z])M_", named):
            yield formula


def test_b_is_the_boundary_c_the_papers_d_a_differential_and_m_counts_landmarks():
    assert {page: found for page in READ if page not in QUOTING and (found := list(strays(TEXTS[page])))} == {}
