"""What test_site_pages.py relies on: axe-core finds the faults that it is asked for."""

import pytest
from view import View

PLANTED = {
    "a button without a name": ("<button></button>", "button-name"),
    "a picture without a description": ("<img src='_static/registration.png'>", "image-alt"),
    "pale text": ("<p style='color: #ccc; background: #fff'>pale</p>", "color-contrast"),
    "a pale word of code": ("<pre><span>dark</span><span style='color: #ccc'>pale</span></pre>", "color-contrast"),
    "a slider without a name": ("<div role='slider' tabindex='0' aria-valuenow='1'>o</div>", "aria-input-field-name"),
    "a list of no items": ("<div role='list'><div role='button' tabindex='0'>x</div></div>", "aria-required-children"),
}

# The rules of axe-core, each with what its checks read besides the page.
RULES = """() => axe._audit.rules.map(({id, impact, tags, any, all, none}) => ({id, impact, tags,
    reads: [...any, ...all, ...none].map(check => String(axe._audit.checks[check.id ?? check].evaluate)).join(";")}))"""


@pytest.fixture(scope="module")
def plain_view(window, site_address):
    view = View(window, site_address, "genindex.html")
    yield view
    view.page.close()


@pytest.mark.xdist_group("planted")
def test_what_is_switched_off_could_not_be_found(plain_view):
    """axe.js leaves out 'region' and style sheets: no serious rule that axe-core runs by itself is
    lost."""
    plain_view.axe_findings()
    rules = {rule["id"]: rule for rule in plain_view.page.evaluate(RULES)}
    assert rules["region"]["impact"] == "moderate"
    assert [name for name, rule in rules.items() if "cssom" in rule["reads"]] == ["css-orientation-lock"]
    passed_over = set(plain_view.page.evaluate("axe._audit.tagExclude"))
    assert passed_over & set(rules["css-orientation-lock"]["tags"]) == {"experimental"}


@pytest.mark.xdist_group("planted")
@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_fault_is_found(plain_view, planted):
    html, rule = PLANTED[planted]
    with plain_view.planted(html):
        found = plain_view.axe_findings()
    assert any(finding.startswith(rule) for finding in found)
