"""Every example of README.md and docs/ runs as it stands, and the generated pages are what the code says."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
OF_THE_LANGUAGE = [
    *(f"reference/{name}.md" for name in ("syntax", "models", "problem-and-data", "unknowns", "observations")),
    *("reference/constraints.md", "reference/cameras.md"),
    *("how-to/errors-in-both-coordinates.md", "how-to/many-problems.md"),
]
"""The pages that together describe the language; others may name a clause in passing."""
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from tests.docs.pages import play  # noqa: E402 - the root has to be importable first


def identity(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_every_example_of_a_page_gives_what_it_shows(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    for block, wanted, found in play(page.read_text(encoding="utf-8"), tmp_path):
        assert found == wanted, f"{identity(page)}, line {block.line}"


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_every_link_within_the_project_leads_somewhere(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    targets = [t for t in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"[a-z]+:", t)]
    for target in targets:
        path, _, anchor = target.partition("#")
        place = page if not path else page.parent / path
        assert place.exists(), target
        if anchor:
            titles = re.findall(r"^#+ (.*)$", place.read_text(encoding="utf-8"), flags=re.MULTILINE)
            assert anchor in [re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles], target


def test_generated_pages_are_up_to_date():
    spec = importlib.util.spec_from_file_location("docs_generate", ROOT / "docs" / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.outdated() == [], "python docs/generate.py"


def test_the_language_reference_names_every_clause_and_option():
    from mbm.problem import clauses
    from mbm.problem.reading import declarations

    text = "".join((ROOT / "docs" / page).read_text(encoding="utf-8") for page in OF_THE_LANGUAGE)
    for clause in clauses.CLAUSES:
        assert re.search(rf"`[^`]*\(?{re.escape(clause)}\b[^`]*`", text), clause
    for option in declarations.OPTIONS:
        assert f":{option}" in text, option
