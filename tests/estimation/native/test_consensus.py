"""Consensus ends at the fit to what is inside its limits, by SciPy, whatever the number of threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import mbm
from mbm.estimation.consensus.native import Begun, consensus_many
from mbm.estimation.consensus.rules import rules_of
from mbm.estimation.consensus.types import Asked, observed
from mbm.estimation.minimise.native.packing import Rows
from mbm.estimation.minimise.native.system import system_of
from mbm.estimation.native.code import native_code
from mbm.estimation.settings import settings_of
from mbm.estimation.solve.estimate import assemble
from mbm.solver.decisions import STATED
from tests.robust.scenes import consensus

pytest.importorskip("llvmlite")

CEILING = np.column_stack([1 + 0.3 * (np.arange(48) // 8), 0.7 + 0.3 * (np.arange(48) % 8), np.full(48, 2.7)])
RANGES = """
(problem place
  (data ranges external)
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
  (observe ranges (= range (distance p [x y z])) {noise})
  (solve :robust {rule}))
"""
POSE = """
(problem pose
  (data marks external)
  (camera cam :focal (800 800) :center (320 240))
  (unknowns (T (pose 3)))
  (observe marks (= [u v] (project cam (transform T [x y z]))) :sigma 1)
  (solve :robust {rule}))
"""
PARABOLA = """
(problem parabola
  (data points external)
  (unknowns (a :init 0) (b :init 0) (c :init 0 :sigma 100))
  (observe points (= y (+ a (* x (+ b (* x c))))) {noise})
  (solve :robust {rule}))
"""
NOISES = {"stated": ":sigma {sigma}", "unknown": ""}
RULES = ("lmeds", "ransac", "msac", "gnc")


def ranges(seed, outliers):
    return ranges_and_wrong(seed, outliers)[0]


def ranges_and_wrong(seed, outliers):
    generator = np.random.default_rng(seed)
    place = generator.uniform([0.8, 0.8, 0.3], [2.7, 2.7, 1.3])
    measured = np.linalg.norm(place - CEILING, axis=1) + 0.005 * generator.normal(size=48)
    wrong = generator.choice(48, outliers, replace=False)
    measured[wrong] += 0.5
    return {"ranges": {"x": CEILING[:, 0], "y": CEILING[:, 1], "z": CEILING[:, 2], "range": measured}}, wrong


def scene(seed, count, wrong):
    """Points, their images, of which some are anywhere, and the pose: rotation vector and translation."""
    generator = np.random.default_rng(seed)
    points = generator.uniform(-1, 1, (count, 3))
    place = np.array([*generator.uniform(-0.5, 0.5, 2), generator.uniform(4, 8)])
    turn = Rotation.random(random_state=seed).as_rotvec()
    image = seen([*turn, *place], points) + generator.normal(size=(count, 2))
    image[:wrong] = generator.uniform((0, 0), (640, 480), (wrong, 2))
    return points, image, np.array([*turn, *place])


def seen(pose, points):
    there = Rotation.from_rotvec(pose[:3]).apply(points) + pose[3:]
    return 800 * there[:, :2] / there[:, 2:] + [320, 240]


def marks(seed, count, wrong):
    points, image, _ = scene(seed, count, wrong)
    return {"marks": dict(zip("xyzuv", (*points.T, *image.T), strict=True))}


def parabola(seed, outliers):
    generator = np.random.default_rng(seed)
    x = np.linspace(-1, 2, 31)
    y = 1 + 2 * x - 0.5 * x**2 + 0.1 * generator.normal(size=31)
    wrong = generator.choice(31, outliers, replace=False)
    y[wrong] += generator.uniform(2, 9, outliers)
    return {"points": {"x": x, "y": y}}, wrong


def assert_agreement(text, data, wrong=()):
    """What consensus promises, by SciPy: the fit to the units inside, their noise, and no other unit inside.

    Units that are ``wrong`` by far are not.
    """
    found = consensus(text, data)
    answer, equations, units = found.agreed, found.equations, found.units
    assert not answer.inliers[np.asarray(wrong, dtype=int)].any()
    deviations = np.ones(equations.whole)
    deviations[units.of_row >= 0] = np.sqrt(answer.variances)[units.of_row[units.of_row >= 0]]
    rows = (units.of_row < 0) | answer.inliers[units.of_row]
    squares = units.squares(equations.plain_residuals(answer.point))
    np.testing.assert_array_equal(answer.inliers, squares <= answer.limits)

    def residuals(step):
        return (equations.plain_residuals(equations.retract(answer.point, step)) / deviations)[rows]

    scale = np.linalg.norm(equations.plain_jacobian(answer.point) / deviations[:, None], axis=0)
    best = least_squares(lambda step: residuals(step / scale), np.zeros(equations.dimension), method="lm", xtol=1e-12)
    # Steps end where they promise 1e-12 of a squared deviation (1e-6 deviations), and where SciPy's differences end.
    assert np.abs(best.x).max() < 1e-5
    for group in np.unique(units.group).tolist():
        mine = (units.group == group) & answer.inliers
        if group == STATED or not mine.any():
            continue
        share = units.components[answer.inliers].sum()
        freedom = units.components[mine].sum() * (1.0 - equations.dimension / share)
        cut, sizes = answer.limits[mine] / answer.variances[mine], units.components[mine]
        left = chi2.cdf(cut, sizes + 2) / chi2.cdf(cut, sizes)  # the variance that normal noise has left inside
        expected = squares[mine].sum() / freedom / ((sizes * left).sum() / sizes.sum())
        np.testing.assert_allclose(answer.variances[mine], expected, rtol=1e-8)
    return answer


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("noise", NOISES)
def test_ranges(rule, noise):
    text = RANGES.format(rule=rule, noise=NOISES[noise].format(sigma="5mm"))
    for seed, outliers in enumerate((0, 1, 5, 14)):
        data, wrong = ranges_and_wrong(seed, outliers)
        assert_agreement(text, data, wrong)


@pytest.mark.parametrize("rule", RULES[:3])
def test_poses(rule):
    for seed, (count, wrong) in enumerate([(10, 2), (20, 8), (50, 20)]):
        assert_agreement(POSE.format(rule=rule), marks(seed, count, wrong))


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_trials_end_when_they_are_enough(share):
    found = [assert_agreement(POSE.format(rule="msac"), marks(seed, 30, round(share * 30))).trials for seed in range(4)]
    # 20 are made at least. Were all good points within three deviations of the best fit to three points, 20 and 32
    # would be enough; without an end there are 100.
    assert all(20 <= trials < 100 for trials in found)


def test_of_six_points_no_better_consensus_is_missed():
    """Fits to three points are exact: only what the others come near to tells which of them to improve."""
    limit = chi2.isf(chi2.sf(9.0, 1), 2)

    def misfit(pose, points, image):
        return np.minimum(np.square(seen(pose, points) - image).sum(axis=1), limit).sum()

    for seed in range(30):
        points, image, truth = scene(seed, 6, 2)
        good = points[2:], image[2:]
        reached = least_squares(lambda pose, p, i: (seen(pose, p) - i).ravel(), truth, method="lm", args=good).x
        solved = mbm.loads(POSE.format(rule="msac")).compile(data=marks(seed, 6, 2)).solve()
        w, *xyz = solved["T"].value[:4]
        found = [*Rotation.from_quat([*xyz, w]).as_rotvec(), *solved["T"].value[4:]]
        # 1e-6 of a squared deviation: both are minima, where steps of 1e-4 deviations and less change no more.
        assert misfit(found, points, image) <= misfit(reached, points, image) + 1e-6


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("noise", NOISES)
def test_subsets_without_a_closed_form_and_a_prior(rule, noise):
    text = PARABOLA.format(rule=rule, noise=NOISES[noise].format(sigma="0.1"))
    for seed, outliers in enumerate((0, 4, 10)):
        data, wrong = parabola(seed, outliers)
        assert_agreement(text, data, wrong)


def test_noise_that_is_stated_too_small_gives_way():
    found = consensus(RANGES.format(rule="lmeds", noise=":sigma 1.5mm"), ranges(5, 5)).agreed
    assert found.limits.min() > 9.0


def test_a_threshold_and_a_number_of_trials_are_kept_to():
    data, wrong = ranges_and_wrong(2, 5)
    found = assert_agreement(RANGES.format(rule="(msac :trials 40 :threshold 2)", noise=":sigma 5mm"), data, wrong)
    assert found.trials == 40
    np.testing.assert_allclose(found.limits, 4.0, rtol=1e-12)


def test_a_batch_is_its_data_sets_one_by_one_whatever_the_threads():
    text = RANGES.format(rule="lmeds", noise="")
    alone, parts = [], []
    compiled = mbm.loads(text).compile(data=ranges(0, 0), backend="native")
    for seed in range(7):
        bound = compiled._for(ranges(seed, 2 * seed))
        found = bound.elaborated
        settings = settings_of(found.problem.request)
        equations, _ = assemble(found.problem, bound.kernels, found.tables, {}, bound.cache)
        system = system_of(equations, settings)
        asked = Asked(problem=found.problem, settings=settings, consensus=settings.robust, ruled=observed)
        rules = rules_of(asked, equations, (True,))
        code = native_code(bound.cache).consensus
        alone.append(consensus_many(system, code, rules, Begun(starts=equations.numbers[None, None])))
        parts.append(system.rows)
    places = np.array([[0, k * parts[0].parameters.size, k * parts[0].weights.size, 0, 0, 0] for k in range(7)])
    joined = Rows(
        parameters=np.concatenate([rows.parameters for rows in parts]),
        weights=np.concatenate([rows.weights for rows in parts]),
        index=parts[0].index,
        columns=parts[0].columns,
        data=np.concatenate([rows.data for rows in parts]) + places,
    )
    starts = Begun(starts=np.tile(equations.numbers, (7, 1, 1)))
    for workers in (1, 2, 3, 7):
        whole = consensus_many(replace(system, rows=joined), code, rules, starts, workers=workers)
        for name in ("points", "states", "inside", "limits", "variances"):
            expected = np.concatenate([getattr(each, name) for each in alone])
            np.testing.assert_array_equal(getattr(whole, name), expected)


def test_data_sets_of_as_many_rows_as_the_first_are_not_probed(monkeypatch):
    compiled = mbm.loads(POSE.format(rule="msac")).compile(data=marks(1, 20, 8), backend="native")
    first = compiled.solve()
    monkeypatch.setattr("mbm.estimation.consensus.forms.minimal_solver", None)
    second = compiled.solve(data=marks(2, 20, 12))
    again = compiled.solve(data=marks(1, 20, 8))
    assert first.to_json() != second.to_json()
    np.testing.assert_array_equal(first.covariance.matrix, again.covariance.matrix)


def test_without_machine_code_the_text_itself_answers(monkeypatch):
    data = marks(3, 8, 2)
    native = mbm.loads(POSE.format(rule="msac")).compile(data=data, backend="numpy").solve()
    monkeypatch.setattr("mbm.kernels.native.engine.hindrance", lambda _: "none can be made")
    plain = mbm.loads(POSE.format(rule="msac")).compile(data=data, backend="numpy").solve()
    # Sums in another order: products are fused in machine code.
    np.testing.assert_allclose(native.covariance.matrix, plain.covariance.matrix, rtol=1e-6)


@pytest.mark.parametrize("backend", ["native", "casadi"])
@pytest.mark.parametrize("gross", [1e9, 1e15, 1e100])
def test_how_gross_one_error_is_changes_nothing(backend, gross):
    """What closed forms learn of the other rows must not drown in the rounding of one that is grossly wrong."""
    problem = mbm.loads(RANGES.format(rule="lmeds", noise=":sigma 5mm"))
    found = []
    for size in (1e3, gross):
        data = ranges(3, 5)
        data["ranges"]["range"][7] = size
        found.append(problem.solve(data=data, backend=backend))
    assert [each.status for each in found] == ["ok", "ok"]
    # The same rows agree, and their least squares is one point: to the solver's last step, far below sigma (1 mm).
    np.testing.assert_allclose(found[1]["p"].value, found[0]["p"].value, atol=1e-9)


WITH_OFFSET = """
(problem place (data ranges external) (unknowns (p (vector 3)) (b))
  (observe d ranges (= range (+ b (norm (- p [x y z])))) :sigma (unknown 0.01))
  (constraints (normal b 0.1 0.5))
  (solve :robust lmeds))
"""


def with_offset(generator, rows):
    stations = generator.uniform(-10.0, 10.0, (rows, 3))
    measured = 0.1 + np.linalg.norm(stations - [1.0, 2.0, 3.0], axis=1) + generator.normal(0.0, 0.01, rows)
    measured[0] += 3.0 if rows > 6 else 0.0
    return {"ranges": {**dict(zip("xyz", stations.T, strict=True)), "range": measured}}


@pytest.mark.parametrize("turn", [1, -1])
def test_answers_do_not_depend_on_the_data_sets_before(turn):
    """To the last bit, for few rows too, of which a closed form learns less."""
    generator = np.random.default_rng(0)
    sets = [with_offset(generator, rows) for rows in (5, 20, 5, 6, 12)]
    compiled = mbm.loads(WITH_OFFSET).compile()
    for data in sets[::turn]:
        found, alone = compiled.solve(data=data).first, mbm.loads(WITH_OFFSET).solve(data=data).first
        assert found.cost == alone.cost
        for own, other in zip(found.estimates, alone.estimates, strict=True):
            np.testing.assert_array_equal(own.value, other.value)
