"""The page: well-formed, self-contained, and deaf to markup in any text it shows."""

import json
import re
from html.parser import HTMLParser

import pytest
from pages import box, checks, full_report

from flexplant.errors import InputError, WriteError
from flexplant.report import Report, Section, render, write_report
from flexplant.report.cells import is_digest, number_columns, number_text
from flexplant.report.html import embedded_json
from flexplant.verification import Table

HOSTILE = "</script></style><script>window.hacked=1</script><img src=x onerror=hacked=1>\"'&<!-- {{7*7}}\u2028\udcff"
VOID = {"meta", "input", "img", "br", "link"}


class Page(HTMLParser):
    """Collects elements, checks that they nest, and keeps the content of scripts and styles apart from the text."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.stack: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.scripts = "", []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append((dict(attrs).get("type"), ""))
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if self.stack[-1:] == ["script"]:
            self.scripts[-1] = (self.scripts[-1][0], self.scripts[-1][1] + data)
        elif self.stack[-1:] != ["style"]:
            self.text += data

    def having(self, tag, **wanted):
        return [a for t, a in self.elements if t == tag and all(a.get(k) == v for k, v in wanted.items())]


@pytest.fixture(scope="module")
def html() -> str:
    return render(full_report())


@pytest.fixture(scope="module")
def page(html) -> Page:
    return Page(html)


def test_elements_nest(page):
    assert page.stack == []


def test_the_page_asks_nothing_of_any_other_place(html, page):
    for _, attributes in page.elements:
        for name in ("src", "href", "action", "data", "poster", "srcset"):
            assert (attributes.get(name) or "#").startswith("#")
    own = re.sub(r"<script>.*?</script>", "", html, flags=re.DOTALL)
    assert not re.search(r"https?:|//[a-z]|@import|url\(", own)
    policy = page.having("meta", **{"http-equiv": "Content-Security-Policy"})[0]["content"]
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_plotly_is_inside_once(page):
    assert sum("plotly.js v" in script for _, script in page.scripts) == 1


def test_plots_views_and_payloads_are_all_there(page):
    payloads = [json.loads(script) for kind, script in page.scripts if kind == "application/json"]
    assert sum("data" in p for p in payloads) == len(page.having("div", **{"class": "drawing"}))
    assert sum("shapes" in p for p in payloads) == len(page.having("canvas")) == 1


def test_every_entry_of_the_contents_leads_somewhere(page):
    anchors = {a["id"] for _, a in page.elements if "id" in a}
    links = [a["href"].removeprefix("#") for a in page.having("a")]
    assert len(links) == 1 + 1 + 3 + 1
    assert set(links) <= anchors


def test_text_tiles_tables_checks_and_provenance_are_shown(page):
    for text in (
        "The loop is stable.",
        "675.4",
        "Lightly damped.",
        "112.756",
        "0.0008",
        "No shapes to compare.",
        "0123456789abcdef" * 4,
    ):
        assert text in page.text


def test_the_verdict_counts_and_names_the_failed_checks(page):
    assert "1 of 2 checks failed: phase margin" in page.text
    good = checks()
    passed = Page(render(Report("t", checks=type(good)(good.checks[:1]))))
    assert "All 1 checks passed" in passed.text


def test_badges_say_pass_and_fail_in_words_too(page):
    assert "✓ pass" in page.text
    assert "✗ FAIL" in page.text


def test_hostile_text_stays_text():
    html = render(full_report(lambda text: HOSTILE + text))
    page = Page(html.replace("\udcff", "?"))
    assert page.stack == []
    assert not page.having("img")
    assert not any(script.startswith("window.hacked") for _, script in page.scripts)
    assert "{{7*7}}" in page.text
    for kind, script in page.scripts:
        if kind == "application/json":
            json.loads(script)
            assert not set("<>&\u2028") & set(script)


def test_sections_of_one_name_get_their_own_anchors():
    page = Page(render(Report("t", sections=(Section("Modes"), Section("Modes"), Section("Summary"), Section("Ωß")))))
    ids = [a["id"] for a in page.having("section")]
    assert ids == ["modes", "modes-2", "summary-2", "section"]


def test_what_cannot_be_shown_is_refused_by_name():
    with pytest.raises(InputError, match="section 'Modes': cannot show a dict"):
        render(Report("t", sections=(Section("Modes", ({},)),)))  # type: ignore[arg-type]


def test_an_empty_report_is_still_a_page():
    assert Page(render(Report("Nothing yet"))).stack == []


def test_the_file_is_written_whole_or_not_at_all(tmp_path):
    report = Report("Größe \udcff", sections=(Section("Structure", (box(),)),))
    path = write_report(report, tmp_path / "report.html")
    assert "<h1>Größe ?</h1>" in path.read_text(encoding="utf-8")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(WriteError, match="no folder"):
        write_report(report, tmp_path / "missing" / "report.html")


def test_embedded_json_reads_back():
    value = {"name": HOSTILE.replace("\udcff", ""), "values": [1.5, None]}
    assert json.loads(embedded_json(value)) == value


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (True, "yes"),
        (6, "6"),
        (6.0, "6"),
        (106.99834, "106.998"),
        (0.0, "0"),
        (2.08e-5, "2.08e-5"),
        (0.00014556, "0.0001456"),
        (0.00210035, "0.0021"),
        (1e-9, "1e-9"),
        (-1.23456e-12, "-1.235e-12"),
        (1234567.0, "1234567"),
        (1e12, "1e12"),
        (float("nan"), "–"),
        (float("-inf"), "−∞"),
        ("dual", "dual"),
    ],
)
def test_cells_read_well(value, text):
    assert number_text(value) == text


def test_columns_of_numbers_may_have_blanks():
    rows = (("a", 1.0, None, True), ("b", 2, 3.0, False))
    assert number_columns(Table("t", ("1", "2", "3", "4"), rows)) == [False, True, True, False]


def test_an_approximate_zero_leaves_its_column_to_the_right():
    rows = (("Rigid body 1", "~0", 1e-4, ""), ("Axial 1", 107.0, 107.001, 0.0021))
    assert number_columns(Table("t", ("mode", "published", "coupled", "error"), rows)) == [False, True, True, True]


def test_a_table_without_rows_is_shown_as_its_heading():
    table = Table("Nothing found", ("Mode", "Hz"), ())
    assert number_columns(table) == [False, False]
    assert "Nothing found" in Page(render(Report("t", sections=(Section("Modes", (table,)),)))).text


def test_digests_are_told_from_words():
    assert is_digest("sha256:" + "0a" * 32)
    assert not is_digest("bus.OU1")
