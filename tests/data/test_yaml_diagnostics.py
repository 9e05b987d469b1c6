"""What is said of YAML files that are none, or lack what is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

import mbm


@pytest.mark.parametrize(
    ("content", "code", "said"),
    [("%YAML:1.0\n---\na: [1, 2\n", "malformed-yaml", "f.yml"), ("%YAML:1.0\n---\nb: 1\n", "no-node", "`a`")],
)
def test_what_is_wrong_is_said_of_the_file(content: str, code: str, said: str, tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    (tmp_path / "f.yml").write_text(content)
    problem = tmp_path / "p.mbm"
    problem.write_text('(problem p (data t (opencv "f.yml" "a")) (unknowns (m)) (observe t (= c1 m)))')
    with pytest.raises(mbm.MbmError) as raised:
        mbm.load(problem).solve()
    (fault,) = raised.value.diagnostics
    assert fault.code.name == code
    assert said in fault.message


def test_what_lacks_at_the_end_is_said_of_the_last_line(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    (tmp_path / "f.yml").write_text("%YAML:1.0\n---\nflags: 3\nK: !!opencv-matrix\n   rows: 3\n   c\n")
    problem = tmp_path / "p.mbm"
    problem.write_text('(problem p (data t (opencv "f.yml" "K")) (unknowns (m)) (observe t (= c1 m)))')
    with pytest.raises(mbm.MbmError) as raised:
        mbm.load(problem).solve()
    (fault,) = raised.value.diagnostics
    assert fault.code.name == "malformed-yaml"
    assert getattr(fault.place, "row", None) == 6
