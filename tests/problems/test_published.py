"""Published measurements of ``problems/published``: each digit that is printed, by a problem file of a few lines."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbm

PUBLISHED = Path(__file__).parents[2] / "problems" / "published"
CASES = {
    f"{file.parent.name}/{name}": (file.parent, name, case)
    for file in sorted(PUBLISHED.glob("*/published.json"))
    for name, case in json.loads(file.read_text(encoding="utf-8")).items()
}
LINES = 10
"""Of the problem, without the comment above it: six of the thirty-two have 9 or 10, which their many inputs fill."""


def unit(printed: str) -> float:
    """One of the last digit that is printed: 0.001 of ``127.732``, 1e-6 of ``1.50e-4``."""
    mantissa, _, exponent = printed.partition("e")
    return 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))


def rounds_to(found: float, printed: str) -> bool:
    """Half a unit of the last digit, and what a float adds."""
    return abs(found - float(printed)) <= 0.5 * unit(printed) * (1 + 1e-9)


def numbers(result: Any, case: dict[str, Any]) -> Iterator[tuple[str, float, str]]:
    """What the case prints: the name of the number, what was found, and the text in print."""
    for name, printed in case.get("values", {}).items():
        quantity = result[name]
        for kind, text in printed.items():
            # "k" is the factor of the publication, of whose multiple of the standard deviation "U" is printed
            found = float(printed["k"]) * quantity.sigma if kind == "U" and "k" in printed else None
            if kind == "k" and "U" in printed:
                continue
            values = np.atleast_1d(getattr(quantity, kind) if found is None else found)
            texts = text if isinstance(text, list) else [text]
            for place, (each, one) in enumerate(zip(values, texts, strict=True)):
                yield f"{name}.{kind}" + (f"[{place + 1}]" if len(texts) > 1 else ""), float(each), one
    for pair, text in case.get("correlations", {}).items():
        yield pair, result.correlation.of(*pair.split()), text
    for name, text in case.get("noise", {}).items():
        yield f"noise.{name}", float(result.solves[0].noise[name]), text
    for name in ("cost", "dof"):
        if name in case:
            yield name, float(getattr(result.solves[0], name)), case[name]


@pytest.mark.parametrize("case", CASES)
def test_printed_digits(case: str) -> None:
    """All of them but those that ``differs`` names: there the digits of the file's inputs are foreseen, and why."""
    folder, name, printed = CASES[case]
    result = mbm.load(folder / f"{name}.mbm").solve()
    assert result.status.value == "ok"
    differs = dict(printed.get("differs", {}))
    for number, found, text in numbers(result, printed):
        other = differs.pop(number, None)
        if other is None:
            assert rounds_to(found, text), (number, found, text)
        else:
            assert rounds_to(found, other["digits"]), (number, found, other)
            assert not rounds_to(found, text), (number, found, text)
            assert len(other["why"]) > 20
    assert not differs


@pytest.mark.parametrize("case", [case for case in CASES if "propagate" in CASES[case][2]])
def test_printed_digits_by_draws(case: str) -> None:
    """Half a unit of the last digit and what chance allows for 100,000 draws, in four standard deviations.

    The 2.5 % quantile of a normal distribution has the standard deviation 0.0085 σ then; the ends of the shortest
    interval scatter more, as its length hardly changes where it is least.
    """
    trials = 100_000
    folder, name, printed = CASES[case]
    for settings in printed["propagate"]:
        found = mbm.load(folder / f"{name}.mbm").propagate(trials, seed=3, constants=settings.get("set", {}))
        for quantity, wanted in settings["values"].items():
            part = found[quantity]
            chance = {"mean": 4 / np.sqrt(trials), "sigma": 4 / np.sqrt(trials), "interval": 0.034, "shortest": 0.068}
            for kind, text in wanted.items():
                if kind == "k":  # of the factor that the interval of the draws has
                    assert np.diff(part.interval)[0] / 2 / part.sigma == pytest.approx(float(text), abs=0.01)
                    continue
                for one, each in zip(np.atleast_1d(getattr(part, kind)), np.atleast_1d(text), strict=True):
                    allowed = unit(str(each)) / 2 + chance[kind] * float(part.sigma)
                    assert abs(float(one) - float(each)) <= allowed, (quantity, kind, one, each)


def test_each_file_has_its_case_and_is_short() -> None:
    files = {f"{file.parent.name}/{file.stem}": file for file in PUBLISHED.glob("*/*.mbm")}
    assert set(files) == set(CASES)
    for file in files.values():
        lines = file.read_text(encoding="utf-8").splitlines()
        assert lines[0].startswith(";; ")
        assert sum(not line.startswith(";;") for line in lines) <= LINES, file.name
