"""Consensus in every way that mbm has, against all minimal samples: never worse than the best of them."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from tests.oracles.brute_force import LIMIT, SCENES, order_statistic, outliers, truncated
from tests.oracles.kinds import drawn
from tests.oracles.paths import PATHS, generated_c, generated_python

WAYS = ("native", "casadi", "numpy", "compiled", "for-each", "window", "estimator")
QUICK = ("native", "numpy", "for-each", "estimator")
RULES = ("msac", "ransac", "lmeds")
SETS = 12

LOST = 1
"""Rows that the count of RANSAC may lose against its best sample: the fit to its rows moves one across the limit, and
has the smaller truncated sum, which is what the candidates are compared by once they are fitted."""

ROBUST = 2.5 * 1.4826
"""Robust standard deviations within which rows of unknown noise agree (docs/explanations/consensus.md)."""


def asked(scene: str, noise: str, rule: str):
    """The problem with as many trials as there are samples."""
    return SCENES[scene].kind(noise, f"({rule} :trials 500)")


@functools.cache
def data_sets(scene: str, sets: int, seed: int):
    kind = asked(scene, "1", "lmeds")
    return [tables["d"] for tables in drawn(f"consensus {scene}", kind, sets, seed)]


@functools.cache
def best(scene: str, sets: int, seed: int) -> list[tuple[float, int, float]]:
    """For each data set the least truncated sum, number of outliers and order statistic of all minimal samples."""
    judge = SCENES[scene]
    found = []
    for data in data_sets(scene, sets, seed):
        scores = [judge.squares(point, data) for point in judge.samples(data)]
        found.append(
            (
                min(truncated(s) for s in scores),
                min(outliers(s) for s in scores),
                min(order_statistic(s, judge.size) for s in scores),
            )
        )
    return found


def fits(judge, data, answer, inside) -> bool:
    """Whether an answer is least squares of these rows: SciPy's differences end at 1e-8 of a standard deviation."""
    return bool(np.abs(judge.refit(data, inside, answer.values) - answer.values).max() < 1e-6 * judge.sigma)


def worse(rule: str, squares: np.ndarray, size: int, wanted: tuple[float, int, float]) -> list[str]:
    """What an answer lacks of the best sample by the score of its own rule."""
    least, count, middle = wanted
    if rule == "msac":  # the same sum in another order
        return [f"truncated sum {truncated(squares)} for {least}"] if truncated(squares) > least + 1e-9 else []
    if rule == "ransac":
        return [f"{outliers(squares)} outliers for {count}"] if outliers(squares) > count + LOST else []
    found, reach = order_statistic(squares, size), (ROBUST * (1 + 5 / (len(squares) - size))) ** 2
    return [f"order statistic {found} for {middle}"] if found > max(LIMIT**2, reach * middle) else []


def wrong_with_stated_noise(scene: str, rule: str, answers, sets: int, seed: int) -> list[str]:
    judge, wrong = SCENES[scene], []
    for data, answer, wanted in zip(data_sets(scene, sets, seed), answers, best(scene, sets, seed), strict=True):
        squares = judge.squares(answer.values, data)
        inside = squares <= LIMIT**2
        wrong += [answer.status] if answer.status != "converged" else []
        wrong += worse(rule, squares, judge.size, wanted)
        wrong += [] if fits(judge, data, answer, inside) else ["no fit to what agrees"]
        wrong += [] if answer.dof in (None, inside.sum() - judge.size) else [f"{answer.dof} degrees of freedom"]
        cost = squares[inside].sum()
        wrong += [] if answer.cost is None or abs(answer.cost - cost) < 1e-9 * (1 + cost) else [f"cost {answer.cost}"]
    return wrong


def wrong_with_unknown_noise(scene: str, answers, sets: int, seed: int) -> list[str]:
    """Rows that agree lie within 2.5 robust deviations: so does, of the best sample's, the middle one of the answer."""
    judge, wrong = SCENES[scene], []
    for data, answer, (_, _, least) in zip(data_sets(scene, sets, seed), answers, best(scene, sets, seed), strict=True):
        squares = judge.squares(answer.values, data)
        reach = (ROBUST * (1 + 5 / (len(squares) - judge.size))) ** 2
        found = order_statistic(squares, judge.size)
        wrong += [answer.status] if answer.status != "converged" else []
        wrong += [f"order statistic {found} for {least}"] if found > reach * least else []
        if answer.dof is not None:
            inside = np.argsort(squares)[: answer.dof + judge.size]  # the rows that agree are the nearest ones
            wrong += [] if fits(judge, data, answer, np.sort(inside)) else ["no fit to what agrees"]
    return wrong


@pytest.mark.parametrize("way", [w if w in QUICK else pytest.param(w, marks=pytest.mark.slow) for w in WAYS])
@pytest.mark.parametrize("scene", SCENES)
def test_no_sample_is_better_where_noise_is_stated(scene, way):
    for rule in RULES:
        kind = asked(scene, str(SCENES[scene].sigma), rule)
        answers = PATHS[way](kind, [{"d": data} for data in data_sets(scene, SETS, 1)])
        assert wrong_with_stated_noise(scene, rule, answers, SETS, 1) == [], rule


@pytest.mark.parametrize("way", [w if w in QUICK else pytest.param(w, marks=pytest.mark.slow) for w in WAYS])
@pytest.mark.parametrize("scene", SCENES)
def test_no_sample_is_much_better_where_noise_is_unknown(scene, way):
    kind = asked(scene, "unknown", "lmeds")
    answers = PATHS[way](kind, [{"d": data} for data in data_sets(scene, SETS, 1)])
    assert wrong_with_unknown_noise(scene, answers, SETS, 1) == []


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_no_sample_is_better_many_times(scene):
    sets = [{"d": data} for data in data_sets(scene, 300, 2)]
    for rule in RULES:
        answers = PATHS["for-each"](asked(scene, str(SCENES[scene].sigma), rule), sets)
        assert wrong_with_stated_noise(scene, rule, answers, 300, 2) == [], rule
    answers = PATHS["for-each"](asked(scene, "unknown", "lmeds"), sets)
    assert wrong_with_unknown_noise(scene, answers, 300, 2) == []


@pytest.mark.slow
@pytest.mark.parametrize("make", [generated_c, generated_python])
@pytest.mark.parametrize("scene", SCENES)
def test_generated_solvers(scene, make, tmp_path):
    sets = [{"d": data} for data in data_sets(scene, SETS, 1)]
    for number, rule in enumerate(RULES):
        answers = make(asked(scene, str(SCENES[scene].sigma), rule), sets, tmp_path / str(number))
        assert wrong_with_stated_noise(scene, rule, answers, SETS, 1) == [], rule
    answers = make(asked(scene, "unknown", "lmeds"), sets, tmp_path / "unknown")
    assert wrong_with_unknown_noise(scene, answers, SETS, 1) == []


@pytest.mark.parametrize("noise", ["0.1", "unknown"])
@pytest.mark.parametrize("way", QUICK)
@pytest.mark.parametrize("scene", ["level", "line", "plane"])
def test_exact_rows_are_met_exactly(scene, way, noise):
    """Where more than half of the rows have no errors at all, the best sample has none, and so has the answer."""
    judge, kind = SCENES[scene], asked(scene, noise, "lmeds")
    generator = np.random.default_rng(5)
    sets, points = [], []
    for _ in range(SETS):
        data, point = judge.draw(generator, 12, 0), generator.normal(size=judge.size)
        data["y"] = judge.residuals(point, {**data, "y": np.zeros(12)})
        wrong = generator.choice(12, int(generator.integers(0, 6 - judge.size // 2)), replace=False)
        data["y"][wrong] += generator.uniform(1, 50, len(wrong))
        sets.append({"d": data})
        points.append(point)
    # Numbers of size one to 300, a condition of some hundred.
    for answer, point in zip(PATHS[way](kind, sets), points, strict=True):
        np.testing.assert_allclose(answer.values, point, rtol=0, atol=1e-11)
