"""The report as one page: what it holds, that it is by itself, that nothing in it is markup but its own."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest

import mbm
from mbm.cli.main import run
from mbm.report.page.types import Picture
from tests.terminal.hostile import HOSTILE, MARKS, objections, write

pytest.importorskip("matplotlib")

LINE = """(problem line
  "A straight line with a <script>alert(1)</script> in its text."
  (data d (csv "d.csv") :columns ((y :unit mm)))
  (unknowns (a :unit mm :doc "offset & more") (b :unit mm))
  (observe readings d (= y (+ a (* b x))) :sigma 0.2mm)
  (derive (at-ten (+ a (* 10 b)) :unit cm)))"""
CSV = "x,y\n0,10.2\n1,11.9\n2,14.1\n3,16.2\n4,17.7\n5,30.0\n"
VOID = {"meta", "br", "hr", "img", "link"}


class Read(HTMLParser):
    """Tags, attributes and the text of a page; fails where a tag is closed that is not open."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.text.append(data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("report")
    (found / "d.csv").write_text(CSV)
    (found / "line.mbm").write_text(LINE)
    return found


@pytest.fixture(scope="module")
def solved(folder):
    return mbm.load(folder / "line.mbm").solve()


@pytest.fixture(scope="module")
def page(solved, folder):
    solved.report(folder / "line.html")
    return (folder / "line.html").read_text(encoding="utf-8")


def test_the_page_has_all_that_is_to_be_said(page, solved):
    text = " ".join(Read(page).text)
    for heading in ("The problem", "Data", "Estimates", "Doubts", "What the data cannot tell", "Uncertainty budget"):
        assert heading in text
    for heading in ("Correlations", "Residuals", "Pictures", "Provenance"):
        assert heading in text
    document = solved.document()
    assert document["inputs"][0]["sha256"] in text
    assert mbm.__version__ in text
    low, high = solved["at-ten"].interval()
    assert f"{low:.3f} … {high:.3f}" in text
    for caption in ("by row", "over x", "over y", "normal quantiles", "leverage", "histogram"):
        assert caption in text
    for diagnostic in solved.diagnostics:
        assert diagnostic.code.name in text


def test_tables_within_the_problem_are_no_files_with_digests(tmp_path):
    text = "(problem p (data d (table (x) (1) (2) (4))) (unknowns (a)) (observe d (= x a)))"
    mbm.loads(text).solve().report(tmp_path / "p.html")
    page = " ".join(Read((tmp_path / "p.html").read_text(encoding="utf-8")).text)
    assert "SHA-256 of the problem" in page
    assert page.count("SHA-256") == 1


def test_the_page_is_by_itself(page):
    read = Read(page)
    assert read.open == []
    assert not {"script", "iframe", "object", "embed", "link", "img", "base", "form"} & set(read.tags)
    assert not [name for name, _ in read.attributes if name.startswith("on")]
    references = [value for name, value in read.attributes if name in ("href", "src", "xlink:href")]
    assert all(value.startswith(("#", "data:image/png;base64,")) for value in references)
    assert "url(http" not in page
    assert "@import" not in page
    names = [value for name, value in read.attributes if name == "id"]
    assert len(names) == len(set(names))
    known = set(names)
    assert all(value[1:] in known for value in references if value.startswith("#"))
    assert set(re.findall(r"url\(#([^)]*)\)", page)) <= known
    assert "default-src 'none'" in page


def test_light_dark_and_paper(page):
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert "currentColor" in page
    assert "fill: #000000" not in page.replace(" ", "").replace("fill:#000000", "fill: #000000")


def test_texts_are_no_markup(page):
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "offset &amp; more" in page


def test_equal_results_give_equal_pages(folder, page):
    mbm.load(folder / "line.mbm").solve().report(folder / "again.html")
    assert (folder / "again.html").read_text(encoding="utf-8") == page


def test_a_pdf(solved, folder):
    pytest.importorskip("reportlab")
    for name in ("a.pdf", "b.pdf"):
        solved.report(folder / name)
    content = (folder / "a.pdf").read_bytes()
    assert content.startswith(b"%PDF-")
    assert content == (folder / "b.pdf").read_bytes()


@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("ending", ["html", "pdf"])
def test_hostile_texts(many, ending, tmp_path, monkeypatch):
    pytest.importorskip("reportlab")
    monkeypatch.chdir(tmp_path)
    mbm.load(write(tmp_path, "problem", many=many)).solve().report(f"out.{ending}")
    if ending == "html":
        written = (tmp_path / "out.html").read_text(encoding="utf-8")
        read = Read(written)
        assert read.open == []
        assert not {"script", "img"} & set(read.tags)
        assert objections(written.replace("\n", "")) == []


def test_pictures_of_hostile_names_are_well_formed():
    from xml.etree import ElementTree as Tree

    from mbm.report.page.pictures import svg

    text = '--><script>alert("x")</script>' + MARKS + HOSTILE

    def panel(axes):
        axes.set_title(text)
        axes.plot([1, 2], [1, 2], label=text)
        axes.legend()

    drawn = svg(Picture(text, panel), 3)
    assert "<script" not in drawn
    root = Tree.fromstring(drawn)  # noqa: S314 - our own
    assert root.tag.endswith("svg")


def test_many_points_are_pixels_and_the_page_stays_small(tmp_path):
    rng = np.random.default_rng(1)
    x = rng.normal(size=30_000)
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma 1))"
    mbm.loads(text).solve(data={"d": {"x": x, "y": x + rng.normal(size=x.size)}}).report(tmp_path / "p.html")
    assert (tmp_path / "p.html").stat().st_size < 3_000_000


def test_many_solves_are_a_table_and_the_worst_of_them(tmp_path):
    y = np.repeat(np.arange(200.0), 3) + np.tile([-1.0, 0.0, 1.0], 200)
    y[3 * 77] += 40.0
    text = "(problem p (data d external) (unknowns (m)) (observe d (= y m) :sigma 1) (for-each k))"
    found = mbm.loads(text).solve(data={"d": {"y": y, "k": np.repeat(np.arange(200), 3)}})
    found.report(tmp_path / "p.html")
    page = (tmp_path / "p.html").read_text(encoding="utf-8")
    text = " ".join(Read(page).text)
    assert "140 more solves" in text
    assert "Among the least trusted: k = 77" in text
    assert len(page) < 2_000_000


def test_nothing_solved(tmp_path):
    text = "(problem m (data d external) (unknowns (a :init 1)) (observe d (= y a) :sigma 1) (for-each k))"
    found = mbm.loads(text).solve(data={"d": {"y": np.zeros(0), "k": np.zeros(0)}})
    found.report(tmp_path / "p.html")
    assert "0 solves" in (tmp_path / "p.html").read_text(encoding="utf-8")


def test_a_pickled_result_has_a_report_without_equations(solved, tmp_path):
    import pickle

    again = pickle.loads(pickle.dumps(solved))  # noqa: S301
    again.report(tmp_path / "p.html")
    text = " ".join(Read((tmp_path / "p.html").read_text(encoding="utf-8")).text)
    assert "Uncertainty budget" in text
    assert "normal quantiles" in text


def test_the_command(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    status = run(["report", "line.mbm", "-o", "out.html", "--seed", "3", "--json", "out.json"])
    assert status in (0, 1)
    text = " ".join(Read((folder / "out.html").read_text(encoding="utf-8")).text)
    assert "mbm report line.mbm -o out.html --seed 3" in text
    assert (folder / "out.json").exists()
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", ["out.txt", "out", "out.svg"])
def test_other_formats_are_refused(solved, folder, name, capsys):
    with pytest.raises(mbm.MbmError) as caught:
        solved.report(folder / name)
    assert caught.value.diagnostics[0].code.name == "report-format"
    assert run(["report", str(folder / "line.mbm"), "-o", str(folder / name)]) == 2
    assert "report-format" in capsys.readouterr().err


def test_what_was_read_is_not_replaced(folder):
    kept = folder / "page.html"
    kept.write_text(LINE)
    with pytest.raises(mbm.MbmError) as caught:
        mbm.load(kept).solve().report(kept)
    assert caught.value.diagnostics[0].code.name == "would-overwrite"
    assert kept.read_text() == LINE


def test_a_page_of_constants_alone(tmp_path):
    """It says that nothing is estimated, and holds no section without content."""
    text = "(problem p (constants (a 2mm :sigma 3um) (b 1mm :sigma 4um)) (derive (c (+ a b) :unit um)))"
    mbm.loads(text).solve().report(tmp_path / "p.html")
    said = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "nothing is estimated, the results follow from the constants" in said
    for absent in ("the estimates are a minimum", "all 0 numbers", "Residuals", "What the data cannot tell"):
        assert absent not in said
    assert "Uncertainty budget" in said
