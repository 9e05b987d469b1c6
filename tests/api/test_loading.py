"""``load``, ``loads``, ``build``: problems from files, texts and Python values; errors carry diagnostics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbm
from mbm.text.types import Span
from tests.api.conftest import TEXT

LINE = '(problem line (data d (csv "d.csv")) (unknowns (a) (b)) (observe d (= y (+ a (* b x)))))'


def test_load_reads_data_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "line.mbm").write_text(LINE, encoding="utf-8")
    (tmp_path / "d.csv").write_text("x,y\n0,1\n1,3\n2,4\n3,4\n", encoding="utf-8")
    result = mbm.load(tmp_path / "line.mbm").solve()
    assert result["a"].value == pytest.approx(1.5, rel=1e-12)
    assert result["b"].value == pytest.approx(1.0, rel=1e-12)
    assert result.document()["file"] == str(tmp_path / "line.mbm")


def test_loads_reads_data_below_its_base(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("x,y\n0,1\n1,3\n", encoding="utf-8")
    assert mbm.loads(LINE, base=tmp_path).solve()["b"].value == pytest.approx(2.0, rel=1e-12)


def test_names_of_a_file_with_several() -> None:
    loaded = mbm.loads(f"{TEXT}\n(problem other :like tag (constants (offset 1m)))")
    assert loaded.names == ("tag", "other")
    with pytest.raises(mbm.MbmError, match="several-problems"):
        loaded.solve()
    assert loaded.named("other").name == "other"


def test_errors_carry_diagnostics_with_places() -> None:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads("(problem p\n  (unknowns (a))\n  (observe (= 1 (sqrtt a))))").solve()
    (found,) = caught.value.diagnostics
    assert found.code.name == "unknown-name"
    assert isinstance(found.place, Span)
    assert (found.place.line, found.place.column) == (3, 18)
    assert "sqrt" in (found.hint or "")


def test_several_errors_in_one_run() -> None:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.loads("(problem p (unknowns (a)) (observe (= 1 zzz)) (observe (= 1 yyy)))").solve()
    assert [d.code.name for d in caught.value.diagnostics] == ["unknown-name", "unknown-name"]


def test_a_missing_file_is_a_diagnostic() -> None:
    with pytest.raises(mbm.MbmError) as caught:
        mbm.load("no-such-file.mbm")
    assert "no-such-file.mbm" in caught.value.diagnostics[0].message


def test_check_answers_diagnostics_instead_of_raising() -> None:
    found = mbm.loads("(problem p (unknowns (a)) (observe (= 1 zzz)))").check()
    assert [d.code.name for d in found] == ["unknown-name"]
    assert mbm.loads("(problem p (unknowns (a)) (observe (= 1 a)))").check() == ()


def test_a_sandbox_confines_reading(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("x,y\n0,1\n1,3\n", encoding="utf-8")
    inside = tmp_path / "inside"
    inside.mkdir()
    text = LINE.replace("d.csv", "../d.csv")
    with pytest.raises(mbm.MbmError, match="outside-sandbox"):
        mbm.loads(text, base=inside, sandbox=inside).solve()
    assert mbm.loads(text, base=inside, sandbox=tmp_path).solve().status == "ok"


def test_a_problem_built_without_text_is_the_same_problem() -> None:
    s, k = mbm.symbol, mbm.keyword
    built = mbm.build(
        "line",
        (s("data"), s("d"), s("external")),
        (s("unknowns"), (s("a"), k("init"), 0), (s("b"), k("init"), 0.5)),
        (s("observe"), s("d"), (s("="), s("y"), (s("+"), s("a"), (s("*"), s("b"), s("x")))), k("sigma"), 0.1),
    )
    data = {"d": {"x": [0, 1, 2, 3], "y": [1, 3, 4, 4]}}
    text = """(problem line (data d external) (unknowns (a :init 0) (b :init 0.5))
                (observe d (= y (+ a (* b x))) :sigma 0.1))"""
    one, two = built.solve(data=data).document(), mbm.loads(text).solve(data=data).document()
    one["solves"][0].pop("seconds"), two["solves"][0].pop("seconds")
    assert one == two


def test_a_value_that_is_no_form_is_refused() -> None:
    with pytest.raises(TypeError):
        mbm.build("p", (mbm.symbol("unknowns"), object()))
    with pytest.raises(TypeError, match="a name is a text"):
        mbm.build(3)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [np.array, list, lambda values: [np.int64(v) for v in values]])
def test_numbers_and_arrays_of_numpy_are_forms(kind: Any) -> None:
    s, k = mbm.symbol, mbm.keyword
    size, sigma, fixed = np.int64(2), np.float32(0.5), np.bool_(False)
    unknown = (s("v"), (s("vector"), size), k("init"), kind([1, 2]), k("fixed"), fixed)
    built = mbm.build("p", (s("unknowns"), unknown), (s("observe"), (s("="), kind([3, 4]), s("v")), k("sigma"), sigma))
    found = built.solve()["v"]
    np.testing.assert_allclose(found.value, [3, 4], rtol=1e-12)
    np.testing.assert_allclose(found.sigma, [0.5, 0.5], rtol=1e-12)


@pytest.mark.parametrize("value", [np.nan, -np.inf, np.float32("nan"), float("nan")])
def test_numbers_that_are_not_finite_are_no_forms(value: float) -> None:
    s = mbm.symbol
    with pytest.raises(mbm.MbmError, match=r"bad-number: `-?(nan|inf)` is no finite number"):
        mbm.build("p", (s("unknowns"), (s("a"), mbm.keyword("init"), value)))


def test_values_in_one_another_without_end_are_refused() -> None:
    round_about: list[Any] = []
    round_about.append(round_about)
    with pytest.raises(mbm.MbmError, match="too-deeply-nested"):
        mbm.build("p", (mbm.symbol("observe"), round_about))


def test_the_package_offers_what_it_says() -> None:
    assert set(mbm.__all__) <= set(dir(mbm))
    for name in mbm.__all__:
        assert getattr(mbm, name) is not None
    with pytest.raises(AttributeError, match="no attribute"):
        getattr(mbm, "no_such_name")  # noqa: B009 - the name is to be looked up when the test runs


def test_what_is_wrong_with_a_text_is_said_when_it_is_read(tmp_path: Path) -> None:
    """Not when something is asked of the problem first."""
    wrong = "(problem p (data d"
    with pytest.raises(mbm.MbmError, match="unclosed-bracket"):
        mbm.loads(wrong)
    (tmp_path / "p.mbm").write_text(wrong)
    with pytest.raises(mbm.MbmError, match="unclosed-bracket"):
        mbm.load(tmp_path / "p.mbm")
