"""The table that a person reads, line by line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

import mbm
from mbm.cli.main import run
from mbm.report.table import table
from mbm.report.types import (
    Estimate,
    Examined,
    FreeDirection,
    Kind,
    Observability,
    Quantity,
    Result,
    SolveReport,
    SolveStatus,
)
from mbm.scales import Scale

ESCAPE = re.compile(r"\x1b\[[0-9;]*m")


def test_one_solve_as_it_is_printed(tag_result: Result) -> None:
    assert table(tag_result, width=80) == (
        "tag.mbm: problem `tag`: converged\n"
        "\n"
        "  p[1]             1200.0    ±  1.0     mm\n"
        "  p[2]              800.0    ±  1.1     mm\n"
        "  p[3]              740      ± 12       mm\n"
        '  offset["left"]      0.250  ±  0.010   m\n'
        '  offset["right"]     0.5    ±  ?       m    no row has receiver right\n'
        "  k0                800                      fixed\n"
        "  psi                 0.5000 ±  0.0020  rad  = 28.65 ± 0.11 deg\n"
        "  height[1]           0.7400 ±  0.0020  m    derived\n"
        "  height[2]           0.7500 ±  0.0030  m    derived\n"
        "\n"
        "chi² = 42.1 with 42 degrees of freedom, p = 0.47\n"
        "`ranges`: 45 of 48 rows, rms 0.98\n"
        'in no equation: `offset["right"]`\n'
        "`p[3]` lies 4 standard deviations from its prior 0.7 ± 0.01\n"
        "warning[near-bound]: `p[3]` is near its upper bound\n"
    )


def test_colour_adds_nothing_but_colour(tag_result: Result, epochs: Result) -> None:
    for result in (tag_result, epochs):
        colored = table(result, color=True)
        assert "\x1b[" in colored
        lines = [line.rstrip() for line in ESCAPE.sub("", colored).splitlines()]
        assert lines == table(result).splitlines()


def test_verbose_says_how_it_was_solved(tag_result: Result) -> None:
    assert "lm: 6 iterations, 8 evaluations, 0.4 ms" in table(tag_result, full=True)


def test_many_solves_have_a_line_each(epochs: Result) -> None:
    assert table(epochs, width=80) == (
        "tags.mbm: problem `tags`\n"
        "\n"
        "epoch  status         x (m)            cost  dof\n"
        "1      converged        1.250 ± 0.012  3.5   3\n"
        "2      not-converged\n"
        "3      unobservable   -10.500 ± 0.012  3.5   3\n"
        "\n"
        "3 solves: 1 converged, 1 not-converged, 1 unobservable\n"
        "together: cost 7 with 6 degrees of freedom\n"
        "epoch = 2: not-converged: the iteration stopped before it reached a minimum\n"
        "epoch = 3: unobservable: not determined by the data: `x` and `b` scale together\n"
    )


def test_long_families_are_cut(tag: SolveReport, tag_result: Result) -> None:
    family = Estimate(
        quantity=Quantity(name="q", unit="m"),
        value=np.arange(60.0),
        sigma=np.full(60, 0.1),
        fixed=np.zeros(60, dtype=bool),
        keys=tuple(f"k{i}" for i in range(60)),
        per="dofs",
    )
    result = replace(tag_result, solves=(replace(tag, estimates=(family,)),))
    short = table(result)
    assert "… 40 more of `q` (-v shows all)" in short
    assert 'q["k19"]' in short
    assert 'q["k20"]' not in short
    assert 'q["k59"]' in table(result, full=True)


def test_many_solves_are_cut(epochs: Result) -> None:
    solves = tuple(replace(epochs.solves[0], key={"epoch": float(i)}) for i in range(150))
    text = table(replace(epochs, solves=solves))
    assert "… 100 more solves (-v shows all)" in text
    assert "150 solves: 150 converged" in text
    assert len(table(replace(epochs, solves=solves), full=True).splitlines()) == 150 + 6


def test_columns_that_do_not_fit_are_counted(epochs: Result) -> None:
    estimates = tuple(
        Estimate(
            quantity=Quantity(name=f"unknown-{i}"), value=np.array(1.5), sigma=np.array(0.1), fixed=np.array(False)
        )
        for i in range(12)
    )
    result = replace(epochs, solves=tuple(replace(solve, estimates=estimates) for solve in epochs.solves))
    text = table(result, width=80)
    assert max(map(len, text.splitlines())) <= 80
    shown = text.count("unknown-")
    assert f"… {12 - shown} more columns" in text


def test_an_unsolved_problem_says_why(tag: SolveReport, tag_result: Result) -> None:
    solve = replace(
        tag,
        status=SolveStatus.NOT_CONVERGED,
        message="the limit of iterations was reached before the estimates settled",
    )
    lines = table(replace(tag_result, solves=(solve,))).splitlines()
    assert lines[0] == "tag.mbm: problem `tag`: not-converged"
    assert lines[1] == "the limit of iterations was reached before the estimates settled"


def test_a_cause_that_is_a_diagnostic_is_said_once(tag: SolveReport, tag_result: Result) -> None:
    cause = replace(tag.diagnostics[0], message="no values meet all of `far`, `near`")
    solve = replace(
        tag, status=SolveStatus.INFEASIBLE, message=cause.message, examination=Examined(diagnostics=(cause,))
    )
    lines = table(replace(tag_result, solves=(solve,))).splitlines()
    assert lines[0] == "tag.mbm: problem `tag`: infeasible"
    assert lines[1] == f"warning[{cause.code.name}]: {cause.message}"
    assert sum(cause.message in line for line in lines) == 1


def test_what_is_free_is_said_in_words(tag: SolveReport, tag_result: Result) -> None:
    scale = FreeDirection(sentence="`xg`, `yg`, `zg` scale together", unknowns=("xg", "yg", "zg"), coefficients={})
    found = Observability(rank=1, dimension=4, condition=2.0, unobservable=(scale,))
    text = table(replace(tag_result, solves=(replace(tag, observability=found),)))
    assert "not determined by the data: `xg`, `yg`, `zg` scale together\n" in text


def test_estimated_noise(tag: SolveReport, tag_result: Result) -> None:
    solve = replace(tag, chi2_p=None, noise={"ranges": 0.00412345})
    text = table(replace(tag_result, solves=(solve,)))
    assert "sum of squares 42.1 with 42 degrees of freedom, sigma0 = 1.001\n" in text
    assert "noise of `ranges` estimated from its residuals: factor 0.004123\n" in text


@pytest.mark.parametrize(("p", "words"), [(1e-9, "larger than the stated noise"), (0.99999, "smaller than the stated")])
def test_a_chi2_that_cannot_be_is_spoken_of(p: float, words: str, tag: SolveReport, tag_result: Result) -> None:
    assert words in table(replace(tag_result, solves=(replace(tag, chi2_p=p),)), width=100)


def test_angles_in_degrees_are_not_said_twice(tag_result: Result, tag: SolveReport) -> None:
    angle = Estimate(
        quantity=Quantity(name="psi", kind=Kind.ANGLE, unit="deg", scale=Scale(np.pi / 180)),
        value=np.array(np.pi / 6),
        sigma=np.array(np.pi / 1800),
        fixed=np.array(False),
    )
    text = table(replace(tag_result, solves=(replace(tag, estimates=(angle,)),)))
    assert "  psi        30.00   ± 0.10    deg\n" in text


def _read(text: str) -> str:
    return str(mbm.loads(text).solve())


def test_intervals_that_a_hard_limit_cuts_are_told() -> None:
    """0.2 ± 0.21 above 0: the shortest interval of the cut normal distribution begins at the limit."""
    text = "(problem p (data d (table (y) (0.1) (0.3))) (unknowns (x :init 1 {limit})) (observe d (= y x) :sigma 0.3))"
    sigma = 0.3 / np.sqrt(2.0)
    high = 0.2 + sigma * norm.ppf(1 - 0.05 * norm.sf(-0.2 / sigma))
    assert f"a hard limit cuts the 95 % interval of `x`: 0.00 … {high:.2f}" in _read(text.format(limit=":in (0 5)"))
    assert "hard limit" not in _read(text.format(limit=":in (-3 5)"))
    assert "hard limit" not in _read(text.format(limit=""))


@pytest.mark.parametrize(
    ("column", "sigma", "unit"),
    [("mm", "unknown", " m"), ("deg", "unknown", " rad"), ("mm", "(unknown 1mm)", ""), ("%", "unknown", "")],
)
def test_noise_that_is_a_standard_deviation_has_its_unit(column: str, sigma: str, unit: str) -> None:
    """2 and 4 about 3 have the standard deviation √2; a factor of a stated size is a pure number."""
    text = f"""(problem p (data d (table (y) (2) (4)) :columns ((y :unit {column}))) (unknowns (a :unit {column}))
      (observe d (= y a) :sigma {sigma}))"""
    size = {"mm": 1e-3 if sigma == "unknown" else 1.0, "deg": np.pi / 180, "%": 0.01}[column] * np.sqrt(2.0)
    said = re.search(r"factor (\S+)(.*)\n", _read(text))
    assert said is not None
    assert float(said[1]) == pytest.approx(size, rel=1e-3)
    assert said[2] == unit


def test_of_a_number_held_at_a_limit_the_interval_begins_there_and_has_two_digits() -> None:
    """-0.2 ± 0.21 above 0.1: the tail of the normal distribution, 95 % of it; 0.1 + 3e-17 is no end."""
    text = "(problem p (data d (table (y) (-0.1) (-0.3))) (unknowns (x :in (0.1 5))) (observe d (= y x) :sigma 0.3))"
    sigma = 0.3 / np.sqrt(2.0)
    high = -0.2 + sigma * norm.isf(0.05 * norm.sf(0.3 / sigma))
    assert f"cuts the 95 % interval of `x`: 0.100 … {high:.3f}\n" in _read(text)
    low, upper = mbm.loads(text).solve()["x"].interval()
    assert low == 0.1
    assert upper == pytest.approx(high, rel=1e-9)


def test_many_cut_intervals_are_counted() -> None:
    text = (
        "(problem p (data d (table (i y) {rows})) (unknowns (x (vector 6) :in (0 5))) (observe d (= y (x i)) :sigma 1))"
    )
    said = _read(text.format(rows=" ".join(f"({i} 0.5)" for i in range(1, 7))))
    assert said.count("a hard limit cuts") == 4
    assert "… and of 2 more numbers (`--intervals`)" in said


def test_a_warning_says_which_solve_it_is_of() -> None:
    """Three readings of which two lie four of their standard deviations from the mean, in the second solve alone."""
    text = """(problem p (data d (table (run y) (1 0.1) (1 -0.1) (1 0) (2 5) (2 -5) (2 0))) (unknowns (a :init 0))
      (for-each run) (observe d (= y a) :sigma 1))"""
    shown = " ".join(table(mbm.loads(text).solve().result).split())
    assert "improbable-noise" in shown
    assert "(run = 2)" in shown


def test_ends_that_are_not_linear_have_digits_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The standard deviation of readings that are all in one step is far larger than the step."""
    text = """(problem p (data d (table (x) (5) (5) (5) (5))) (unknowns (m))
      (observe d (= x m) :sigma 0.1 :resolution 1) (derive (i (/ 1 (- m 4.5)))))"""
    (tmp_path / "p.mbm").write_text(text)
    run(["solve", str(tmp_path / "p.mbm"), "--intervals"])
    solve = mbm.loads(text).solve()
    said = capsys.readouterr().out
    lines = {name: ends for name, *ends in re.findall(r"(?m)^  (\S+) +(\S+) +… +(\S+)", said)}
    for name in ("m", "i"):
        shown = [float(each.replace("∞", "inf")) for each in lines[name]]
        assert shown == pytest.approx(list(solve[name].interval()), rel=0.05)
