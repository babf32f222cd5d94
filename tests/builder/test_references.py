"""Labels, numbers and citations, as the copies for JupyterLab and plain viewers need them."""

import pytest

from book.builder import references
from book.builder.references import Literature, Target, numbered, pages_of

CONTENTS = {
    "root": "index",
    "parts": [
        {"numbered": True, "chapters": [{"file": "a"}]},
        {"chapters": [{"file": "b"}]},
        {"numbered": True, "chapters": [{"file": "c"}]},
    ],
}
TEXT = """
$$
no = label
$$

$$ x = 1 $$ (eq-one)

```python
"$$ not math $$ (eq-no)"
```

:::{math}
:label: eq-two

x
:::

:::{prf:theorem} A title
:label: thm-one

Text.

:::

:::{prf:lemma}
:label: lem-one
:::

:::{prf:theorem}
:label: thm-two
:::

:::{figure}

:name: fig-one

Caption.

:::

:::{exercise} Title
:label: ex-one
:::

(sec-one)=
## A heading
"""


def test_parts_are_numbered_through():
    assert pages_of(CONTENTS) == [("index", None), ("a", 1), ("b", None), ("c", 2)]


def test_labels_have_the_numbers_of_the_book():
    assert {label: target.text for label, target in numbered(TEXT, "page", 4)} == {
        "eq-one": "(4.1)",
        "eq-two": "(4.2)",
        "thm-one": "Theorem 4.1",
        "lem-one": "Lemma 4.1",
        "thm-two": "Theorem 4.2",
        "fig-one": "Fig. 4.1",
        "ex-one": "Exercise 4.1",
        "sec-one": "A heading",
    }


def test_a_page_without_a_chapter_counts_from_one():
    assert dict(numbered(TEXT, "page", None))["eq-two"] == Target("page", "equation", "(2)")


@pytest.fixture
def literature(tmp_path):
    (tmp_path / "some.bib").write_text(
        "@article{one, author={Gödel, Kurt}, title={A}, journal={J}, year={1931}}\n"
        "@article{two, author={Ahlfors, Lars and Bers, Lipman}, title={B}, journal={J}, "
        "year={1960}}\n"
        '@book{many, editor={M{\\"u}ller, A and B, B and C, C}, title={C}, publisher={P}, year={2000}}\n',
        encoding="utf-8",
    )
    return Literature(tmp_path / "some.bib")


@pytest.mark.parametrize(
    "key, sentence, brackets",
    [
        ("one", "Gödel \\[1931\\]", "Gödel, 1931"),
        ("two", "Ahlfors and Bers \\[1960\\]", "Ahlfors and Bers, 1960"),
        ("many", "Müller *et al.* \\[2000\\]", "Müller *et al.*, 2000"),
    ],
)
def test_citations(literature, key, sentence, brackets):
    assert (literature.cited(key, True), literature.cited(key, False)) == (sentence, brackets)


def test_an_unknown_citation_is_named(literature):
    with pytest.raises(KeyError, match="no entry 'three'"):
        literature.cited("three", True)


def test_the_list_of_references_is_sorted_by_author(literature):
    lines = literature.listed(["one", "two"]).splitlines()
    assert [line.split("\\.")[0] for line in lines] == [
        "- Lars Ahlfors and Lipman Bers",
        "- Kurt Gödel",
    ]


def test_every_label_of_the_book_is_numbered_on_its_page():
    found = references.labels()
    assert (
        found["eq-qc-beltrami"].page == "quasiconformal"
        and found["eq-qc-beltrami"].kind == "equation"
    )
    assert {target.page for target in found.values()} <= set(references.chapters())
