"""Errors in columns with many unknowns: by blocks as densely, and as SciPy on the joint problem of all corrections."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm
from mbm.estimation.consensus import consensus
from mbm.estimation.minimise import sparsity

SAME = 1e-8
"""Both stop where the next step is below 1e-10 standard deviations; corrections of far points lose two digits."""

NEAR = 1e-6
"""Standard deviations: SciPy's steps end at 1e-12 of numbers of about 10, whose standard deviations are about 0.02."""

RIMS = """
(problem rims
  (data circles external :key k) (data d external)
  (unknowns (c (vector 2) :per circles :init [cx cy] {c}) (r :per circles :init cr {r}))
  (observe rim d (= (distance [x y] (c k)) (r k)) :errors ((x 0.05) (y sy)) {rim})
  {more})
"""
VARIANTS = {
    "nothing else": {},
    "noise of the equation": {"rim": ":sigma 0.03"},
    "a loss": {"rim": ":loss (huber 1.3)"},
    "a loss that ends": {"rim": ":loss tukey"},
    "some rows": {"rim": ":when (> u -2)"},
    "priors and bounds": {"c": ":sigma 0.1", "r": ":in (1 2.2)"},
    "some fixed": {"r": ":fixed (> k 8)"},
    "consensus": {"more": "(solve :robust lmeds)"},
    "a constraint": {"more": "(constraints (= (r 3) (r 4)))"},
    "equations of two components": {
        "more": """(observe both d (= [u v] (* (r k) [p q])) :errors ((u 0.1) (v 0.2))
          :covariance [[0.01 0.002] [0.002 0.03]])""",
    },
    "others of unknown noise": {"more": "(observe level d (= u (c k 1)) :sigma (unknown 0.5))"},
    "several methods' rule": {"more": "(solve :method lm)"},
}  # fmt: skip


def circles(count: int, rows: int, common: float | None = None) -> dict[str, dict[str, np.ndarray]]:
    """Points about circles, of their own radius or of a ``common`` one."""
    random = np.random.default_rng(5)
    center, radius = random.uniform(-6, 6, (count, 2)), random.uniform(1, 3, count)
    if common is not None:
        radius[:] = common
    k = np.repeat(np.arange(count), rows)
    turn = 2 * np.pi * (np.tile(np.arange(rows), count) + random.uniform(0, 0.7, count * rows)) / rows
    sy = 0.04 + 0.02 * np.cos(np.arange(count * rows)) ** 2
    x = center[k, 0] + radius[k] * np.cos(turn) + 0.05 * random.normal(size=len(k))
    y = center[k, 1] + radius[k] * np.sin(turn) + sy * random.normal(size=len(k))
    u, v = x - center[k, 0] + 0.1 * random.normal(size=len(k)), y - center[k, 1] + 0.2 * random.normal(size=len(k))
    cx, cy = center[:, 0] + 0.1, center[:, 1] - 0.2
    members = {"k": np.arange(float(count)), "cx": cx, "cy": cy, "cr": 0.95 * radius}
    return {
        "circles": members,
        "d": {"k": k.astype(float), "x": x, "y": y, "sy": sy, "u": u, "v": v, "p": np.cos(turn), "q": np.sin(turn)},
    }


def far(tables):
    """The tables with each eleventh point twenty standard deviations farther out."""
    d = tables["d"]
    out = np.where(np.arange(len(d["x"])) % 11 == 0, 1.0 / np.hypot(d["u"], d["v"]), 0.0)
    return {**tables, "d": {**d, "x": d["x"] + out * d["u"], "y": d["y"] + out * d["v"]}}


def solved(tables, **parts):
    return mbm.loads(RIMS.format(**({"c": "", "r": "", "rim": "", "more": ""} | parts))).solve(data=tables)


@pytest.fixture
def everything_sparse(monkeypatch):
    """A context in which small problems are for the sparse solver, too."""

    @contextmanager
    def patched():
        with monkeypatch.context() as each:
            each.setattr(sparsity, "MOST_DENSE", 0)
            each.setattr(sparsity, "SPARSE", 1.0)
            yield

    return patched


def same_answer(found, dense):
    assert found.first.method.endswith("sparse")
    assert not dense.first.method.endswith("sparse")
    assert found.first.status is dense.first.status
    assert found.first.cost == pytest.approx(dense.first.cost, rel=SAME)
    assert found.first.dof == dense.first.dof
    assert found.observability.rank == dense.observability.rank
    for own, other in zip(found.first.estimates, dense.first.estimates, strict=True):
        sigma = np.where(other.sigma > 0, other.sigma, 1.0)
        np.testing.assert_allclose((own.value - other.value) / sigma, 0.0, atol=SAME)
        np.testing.assert_allclose(own.sigma, other.sigma, rtol=SAME)
    for own, other in zip(
        found.first.residual_summaries.values(), dense.first.residual_summaries.values(), strict=True
    ):
        assert (own.used, own.outliers) == (other.used, other.outliers)
    for own, other in zip(found.first.corrections, dense.first.corrections, strict=True):
        np.testing.assert_allclose(own.value / own.sigma, other.value / other.sigma, atol=SAME)


@pytest.mark.parametrize("variant", VARIANTS)
def test_blocks_give_the_dense_answer(everything_sparse, variant):
    tables = far(circles(12, 9))
    with everything_sparse():
        found = solved(tables, **VARIANTS[variant])
    same_answer(found, solved(tables, **VARIANTS[variant]))


def rim(t, x, y, sx, sy):
    """The circle with the nearest true points: unknowns and a direction for each point, solved jointly by SciPy."""

    def misfits(p):
        cx, cy, r, turn = p[0], p[1], p[2], p[3:]
        return np.concatenate([(cx + r * np.cos(turn) - x) / sx, (cy + r * np.sin(turn) - y) / sy])

    start = np.concatenate([t, np.arctan2(y - t[1], x - t[0])])
    found = least_squares(misfits, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    return found.x[:3], np.sqrt(np.diag(covariance)[:3]), 2 * found.cost


def of_member(found, member: int) -> tuple[np.ndarray, np.ndarray]:
    c, r = found["c"], found["r"]
    return np.append(c.value[member], r.value[member]), np.append(c.sigma[member], r.sigma[member])


def test_many_circles_are_those_of_the_joint_problem():
    """306 unknowns, no patch: each circle is a problem of its own for SciPy."""
    tables = circles(102, 8)
    found, d, cost = solved(tables), tables["d"], 0.0
    assert found.first.method == "dogleg-sparse"
    for member in range(102):
        mine = d["k"] == member
        start = [tables["circles"][name][member] for name in ("cx", "cy", "cr")]
        values, sigma, own = rim(np.array(start), d["x"][mine], d["y"][mine], 0.05, d["sy"][mine])
        estimates, sigmas = of_member(found, member)
        np.testing.assert_allclose((estimates - values) / sigma, 0.0, atol=NEAR)
        np.testing.assert_allclose(sigmas, sigma, rtol=1e-5)  # SciPy's derivatives are differences
        cost += own
    assert found.first.cost == pytest.approx(cost, rel=1e-10)


@pytest.mark.parametrize("rim", ["", pytest.param(":sigma 0.02", marks=pytest.mark.slow)])
def test_consensus_of_many_circles_is_that_of_each_alone(everything_sparse, rim):
    """Standard deviations too: factors for the tails that consensus cuts reach them with few unknowns and with many."""
    tables = far(circles(30, 9))
    with everything_sparse():
        found = solved(tables, rim=rim, more="(solve :robust lmeds)")
    assert found.first.method == "dogleg-sparse"
    for member in range(0, 30, 10):
        mine = tables["d"]["k"] == member
        alone = {
            "circles": {name: column[[member]] for name, column in tables["circles"].items()},
            "d": {name: column[mine] for name, column in tables["d"].items()},
        }
        single = solved(alone, rim=rim, more="(solve :robust lmeds)")
        (values, sigma), (own, own_sigma) = of_member(single, 0), of_member(found, member)
        np.testing.assert_allclose((own - values) / sigma, 0.0, atol=NEAR)
        # How many outliers may be within the limits is told by all rows together, of a circle alone by its nine: one
        # factor for its three numbers. A row just beyond the limits counts as one inside, of which one in eight makes
        # 1.24 at limits of 2.6 deviations.
        ratios = own_sigma / sigma
        np.testing.assert_allclose(ratios, ratios[0], rtol=SAME)
        assert 1 / 1.25 < ratios[0] < 1.25


def one_radius(tables, more: str):
    text = RIMS.replace("(r :per circles :init cr {r})", "(r :init 2)").replace("(r k)", "r")
    return mbm.loads(text.format(c="", rim="", more=more)).solve(data=tables)


def test_consensus_of_many_connected_unknowns_draws_no_subsets(monkeypatch):
    """63 unknowns that one radius connects: as without errors in columns, losses find the rows that agree."""
    tables = circles(31, 8, common=2.0)
    wrong = np.arange(len(tables["d"]["x"])) % 11 == 0

    def drawn(*_given, **_named):
        raise AssertionError

    monkeypatch.setattr(consensus, "agreed", drawn)
    found = one_radius(far(tables), "(solve :robust lmeds)")
    (summary,) = found.first.residual_summaries.values()
    assert set(np.flatnonzero(wrong) + 1) <= set(summary.outliers)
    kept = np.ones(len(wrong), dtype=bool)
    kept[np.array(summary.outliers) - 1] = False
    clean = {**tables, "d": {name: column[kept] for name, column in tables["d"].items()}}
    same = one_radius(clean, "")
    np.testing.assert_allclose(found["c"].value, same["c"].value, atol=SAME)
    np.testing.assert_allclose(found["r"].value, same["r"].value, atol=SAME)


SIGHTS = """
(problem sights
  (data targets external :key k) (data stations external :key id) (data d external :with (stations s))
  (unknowns (p (vector 2) :per targets :init [px py] {p}))
  (observe far d (= r (distance (p k) [stations.x stations.y])) {far} :errors ({r} (stations.x 0.1) (stations.y 0.2)))
  {more})
"""
SIGHTS_VARIANTS = {
    "noise of the equations": {},
    "no noise of the equations": {"far": "", "r": "(r 0.05)"},
    "some rows": {"far": ":sigma 0.05 :when (> u -6)"},
    "priors": {"p": ":sigma 0.3"},
    "bounds": {"p": ":in ([-8 -8] [8 8])"},
    "some fixed": {"p": ":fixed (> k 8)"},
    "consensus": {"far": ":sigma 0.05", "more": "(solve :robust lmeds)"},
    "a constraint": {"more": "(constraints (= (p 3 1) (p 4 2)))"},
    "two blocks share": {
        "more": "(observe aside d (= v (- (p k 2) stations.y)) :sigma 0.1 :errors ((stations.y 0.2)))",
    },
    "two components": {
        "more": """(observe both d (= [u v] (- (p k) [stations.x stations.y]))
          :errors ((stations.x 0.1) (stations.y 0.2)) :covariance [[0.01 0.002] [0.002 0.03]])""",
    },
    "rows that share nothing": {"more": "(observe level d (= u (- (p k 1) e)) :sigma 0.1 :errors ((e 0.2)))"},
    "others of unknown noise": {"more": "(observe level d (= e (p k 1)) :sigma (unknown 0.5))"},
    "several methods' rule": {"more": "(solve :method lm)"},
}  # fmt: skip


def sights(cells: int, rows: int = 4) -> dict[str, dict[str, np.ndarray]]:
    """Cells of three targets and eight stations whose measured places several ranges share: two of each to ``rows``."""
    random = np.random.default_rng(8)
    targets, count = random.uniform(-6, 6, (3 * cells, 2)), 8 * cells
    at = random.uniform(-8, 8, (count, 2))
    true = at + [0.1, 0.2] * random.normal(size=(count, 2))
    s = np.repeat(np.arange(count), 2 + np.arange(count) % (rows - 1))
    k = 3 * (s // 8) + np.arange(len(s)) % 3
    away = targets[k] - true[s]
    u, v = (away + [0.1, 0.17] * random.normal(size=(len(s), 2))).T
    r = np.hypot(*away.T) + 0.05 * random.normal(size=len(s))
    near = targets + 0.3 * random.normal(size=targets.shape)
    return {
        "targets": {"k": np.arange(3.0 * cells), "px": near[:, 0], "py": near[:, 1]},
        "stations": {"id": np.arange(float(count)), "x": at[:, 0], "y": at[:, 1]},
        "d": {"s": s.astype(float), "k": k.astype(float), "r": r, "u": u, "v": v, "e": targets[k, 0] - u},
    }


def sighted(tables, **parts):
    return mbm.loads(SIGHTS.format(**({"p": "", "far": ":sigma 0.05", "r": "", "more": ""} | parts))).solve(data=tables)


SHARED = [(v, rows) for v in SIGHTS_VARIANTS for rows in (4, 9) if (v, rows) != ("consensus", 9)]


@pytest.mark.parametrize(("variant", "rows"), [*SHARED, pytest.param("consensus", 9, marks=pytest.mark.slow)])
def test_shared_values_in_blocks_give_the_dense_answer(everything_sparse, variant, rows):
    tables = sights(2 if variant == "consensus" else 4, rows)
    if variant == "consensus":
        tables["d"]["r"][::13] += 3.0
    dense = sighted(tables, **SIGHTS_VARIANTS[variant])
    with everything_sparse():
        found = sighted(tables, **SIGHTS_VARIANTS[variant])
    same_answer(found, dense)


def joint_sights(near, tables, cell: int):
    """A cell with the true places of its stations as further unknowns, solved by SciPy."""
    d, stations = tables["d"], tables["stations"]
    mine, own = d["s"] // 8 == cell, slice(8 * cell, 8 * cell + 8)
    s, k = d["s"][mine].astype(int) % 8, d["k"][mine].astype(int) % 3
    x, y, r = stations["x"][own], stations["y"][own], d["r"][mine]

    def misfits(q):
        p, at = q[:6].reshape(3, 2), q[6:].reshape(2, 8)
        away = np.hypot(p[k, 0] - at[0][s], p[k, 1] - at[1][s])
        return np.concatenate([(at[0] - x) / 0.1, (at[1] - y) / 0.2, (away - r) / 0.05])

    start = np.concatenate([near.ravel(), x, y])
    found = least_squares(misfits, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac", jac="3-point")
    return found.x[:6].reshape(3, 2), 2 * found.cost


def test_many_targets_are_those_of_the_joint_problem():
    """306 unknowns, no patch: each cell is a problem of its own for SciPy, begun at the answer of mbm."""
    tables, cost = sights(51), 0.0
    found = sighted(tables)
    assert found.first.method == "dogleg-sparse"
    for cell in range(51):
        own = slice(3 * cell, 3 * cell + 3)
        p = found["p"]
        values, least = joint_sights(p.value[own] + 0.1 * p.sigma[own], tables, cell)
        np.testing.assert_allclose((p.value[own] - values) / p.sigma[own], 0.0, atol=NEAR)
        cost += least
    assert found.first.cost == pytest.approx(cost, rel=1e-10)


def test_what_has_no_value_is_named_where_it_stands(everything_sparse):
    """Systems stand behind other equations for the sparse solver: places in the data do not."""
    tables = sights(4)
    tables["d"]["u"] = np.abs(tables["d"]["u"])
    tables["d"]["u"][[5, 17]] = -1.0
    parts = {"more": "(observe level d (= (sqrt u) (* (p k 1) (sqrt u))) :sigma 0.1)"}
    with everything_sparse():
        found = sighted(tables, **parts)
    dense = sighted(tables, **parts)
    said = [str(each) for each in found.first.diagnostics]
    assert said == [str(each) for each in dense.first.diagnostics]
    assert "row=6" in said[0]
