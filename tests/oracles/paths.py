"""Every way in which mbm answers a problem today, and what each says of each data set."""

from __future__ import annotations

import csv
import importlib.util
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import mbm
from mbm import compiler
from mbm.compiler import Inputs
from tests.emit.making import run, written
from tests.oracles.kinds import Answer, Kind, Tables

LARGE = 301
"""Unknowns from which on a problem is large and sparse."""

EVERY = slice(None)
"""All data sets."""

KEYS = 1000.0
"""Between the keys of two data sets: more than a data set has."""


def flat(parts) -> np.ndarray:
    return np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in parts])


def of_report(report) -> Answer:
    """One solve of a result."""
    sigmas = [
        np.where(False if e.at_bound is None else e.at_bound, np.nan, np.nan if e.sigma is None else e.sigma)
        for e in report.estimates
    ]
    return Answer(
        values=flat(e.value for e in report.estimates),
        sigmas=flat(sigmas),
        status=report.status,
        cost=report.cost,
        dof=report.dof,
        factors=np.array([np.nan if f is None else f for f in report.noise.values()]),
        derived=np.array([[float(d.value), float(d.sigma)] for d in report.derived if np.ndim(d.value) == 0]),
    )


def alone(kind: Kind, sets: Sequence[Tables], backend: str, clause: str = "") -> list[Answer]:
    """Each data set as a problem of its own."""
    problem = mbm.loads(kind.text(clause))
    return [of_report(problem.solve(data=tables, backend=backend, allow_external=kind.calls).record) for tables in sets]


def compiled(kind: Kind, sets: Sequence[Tables], backend: str) -> list[Answer]:
    """One compiled problem for all data sets."""
    once = mbm.loads(kind.text()).compile(data=sets[0], backend=backend, allow_external=kind.calls)
    return [of_report(once.solve(data=tables).record) for tables in sets]


def joined(kind: Kind, sets: Sequence[Tables], *, apart: bool = False) -> Tables:
    """All data sets one below the other, with their number; tables with keys, which all share, as they are.

    ``apart``: those with `Kind.keys` are no longer shared; keys count on from set to set.
    """
    found = {}
    for name in sets[0]:
        key = kind.keys.get(name) if apart else None
        if ":key" in kind.options.get(name, "") and key is None:
            found[name] = dict(sets[0][name])
            continue
        columns = {c: np.concatenate([each[name][c] for each in sets]) for c in sets[0][name]}
        sizes = [len(next(iter(each[name].values()))) for each in sets]
        number = np.repeat(np.arange(len(sets)), sizes)
        if key is not None:
            columns[key] = columns[key] + KEYS * number
        found[name] = {"set": number, **columns}
    return found


def together(kind: Kind, sets: Sequence[Tables], clause: str, read: slice = EVERY) -> list[Answer]:
    """All data sets in one problem, ``clause`` tells them apart; what is said of those to ``read``."""
    solved = mbm.loads(kind.text(clause)).solve(data=joined(kind, sets), allow_external=kind.calls)
    assert len(solved.solves) == len(sets)
    return [of_report(solved.result.solves[i]) for i in range(len(sets))[read]]


def estimator(kind: Kind, sets: Sequence[Tables], clause: str = "") -> list[Answer]:
    """Columns in, numbers out, all data sets at once; and the first by itself, which must be the same to the bit."""
    function = mbm.loads(kind.text(clause)).compile(data=sets[0], allow_external=kind.calls).estimator(*kind.given)
    places = [each.split(".") for each in function.inputs]
    columns = [[each[table][column] for each in sets] for table, column in places]
    found = function.many(*(np.stack(each) for each in columns))
    single = function(*(each[0] for each in columns))
    assert np.array_equal(single.values, found.values[0])
    assert np.array_equal(single.sigma, found.sigma[0], equal_nan=True)
    return [
        Answer(values=v, sigmas=s, status=str(t), cost=float(c))
        for v, s, t, c in zip(found.values, found.sigma, found.status, found.cost, strict=True)
    ]


def members(kind: Kind, sets: Sequence[Tables], least: int = 0, clause: str = "") -> list[Answer]:
    """All data sets as one problem whose unknowns are families; repeated until there are ``least`` numbers."""
    times = -(-least // (len(sets) * len(kind.apart(np.array(kind.start), np.array(kind.start)))))
    many = list(sets) * max(times, 1)
    tables = joined(kind, many, apart=True)
    if "{over}" in kind.clauses:
        tables["sets"] = {"set": np.arange(float(len(many)))}
    solved = mbm.loads(kind.text(clause, per="set")).solve(data=tables, allow_external=kind.calls)
    found = [solved[name] for name in kind.unknowns]
    report = solved.first
    return [
        Answer(
            values=flat(each.value[i] for each in found),
            sigmas=flat(each.sigma[i] for each in found),
            status=report.status,
        )
        for i in range(len(sets))
    ]


def beside(kind: Kind, sets: Sequence[Tables], least: int, clause: str = "") -> list[Answer]:
    """Each data set in a problem with ``least`` further rows, each with an offset of its own from the first number.

    They say nothing of that number, and their residuals vanish: the answer is that of the data set alone.
    """
    name, stated = next((name, stated) for name, stated in kind.unknowns.items() if ":per" not in stated)
    number = f"(dot {name} [1 0])" if stated.startswith("(vector") else name
    further = f"(unknowns (beyond :per far.place :init 0)) (observe far (= z (+ {number} (beyond place))) :sigma 0.7)"
    problem = mbm.loads(kind.text(f"(data far external) {further} {clause}"))
    far = {"place": np.arange(float(least)), "z": np.cos(np.arange(least))}
    solved = [problem.solve(data={**tables, "far": far}, allow_external=kind.calls).record for tables in sets]
    return [
        of_report(
            replace(
                report,
                estimates=tuple(e for e in report.estimates if e.quantity.name != "beyond"),
                noise={clause: factor for clause, factor in report.noise.items() if clause != "far"},
            )
        )
        for report in solved
    ]


def generated_python(kind: Kind, sets: Sequence[Tables], folder: Path, clause: str = "") -> list[Answer]:
    """A generated solver in Python, made with the first data set."""
    written(emitted(kind, sets[0], clause), folder)
    spec = importlib.util.spec_from_file_location("oracle_solver", folder / "p.py")
    module = importlib.util.module_from_spec(spec)
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = before
    answers = []
    for tables in sets:
        found = module.solve(tables)
        values = flat(found["estimates"][name]["value"] for name in kind.unknowns)
        n = len(values) if kind.moved is None else len(kind.apart(values, values))
        # true values of measured columns are unknowns behind the others
        sigmas = np.sqrt(np.diag(found["covariance"]))[:n]
        answers.append(
            Answer(
                values=values,
                sigmas=sigmas,
                status=found["status"],
                cost=found["cost"],
                dof=found["freedom"],
                derived=np.array([[v.item() for v in each.values()] for each in found.get("derived", {}).values()]),
            )
        )
    return answers


def generated_c(kind: Kind, sets: Sequence[Tables], folder: Path, clause: str = "") -> list[Answer]:
    """A generated program in C, of all data sets."""
    written(emitted(kind, joined(kind, sets), f"(for-each set) {clause}", "c"), folder)
    made = run("make", "all", "CFLAGS=-O1", folder=folder)
    assert made.returncode == 0, made.stdout + made.stderr
    tables = re.findall(r'"(data/.+?)"', (folder / "test.c").read_text())
    found = run("./p", *tables, folder=folder)
    rows = list(csv.DictReader(found.stdout.splitlines()))
    ends = re.findall(r"(.+): chi2 (.+), (\d+) degrees", found.stderr)
    assert len(ends) == len(sets), found.stderr
    assert found.returncode == int(any(status != "converged" for status, _, _ in ends)), found.stderr
    answers = []
    for number, (status, _, dof) in enumerate(ends):
        every = [r for r in rows if float(r["set"]) == number]
        mine = [r for r in every if r["name"].split("[")[0] in kind.unknowns]
        others = [r for r in every if r not in mine]
        sigmas = np.array([float(r["sigma"] or np.inf) for r in mine])  # poses and rotations are printed without
        answers.append(
            Answer(
                values=np.array([float(r["value"]) for r in mine]),
                sigmas=None if np.isinf(sigmas).any() else sigmas,
                status=status,
                dof=int(dof),
                derived=np.array([[float(r["value"]), float(r["sigma"] or np.nan)] for r in others]),
            )
        )
    return answers


def emitted(kind: Kind, tables: Tables, clause: str, target: str = "python"):
    """The files of a generated solver."""
    problem = mbm.loads(kind.text(clause))
    found = compiler.elaborated(problem.program, problem.name, Inputs(tables=tables), problem.registry)
    return compiler.emitted(found, target, problem.registry)


CLAUSES = {"for-each": "(for-each set)", "window": "(window set :length 1 :step 1)"}
"""Of ways that solve all data sets in one problem."""

Ask = Callable[[Kind, Sequence[Tables]], list[Answer]]
PATHS: dict[str, Ask] = {
    "native": lambda kind, sets: alone(kind, sets, "native"),
    "casadi": lambda kind, sets: alone(kind, sets, "casadi"),
    "numpy": lambda kind, sets: alone(kind, sets, "numpy"),
    "compiled": lambda kind, sets: compiled(kind, sets, "native"),
    "for-each": lambda kind, sets: together(kind, sets, CLAUSES["for-each"]),
    "window": lambda kind, sets: together(kind, sets, CLAUSES["window"]),
    "estimator": estimator,
    "members": members,
    "large": lambda kind, sets: members(kind, sets, LARGE),
    "dogleg": lambda kind, sets: alone(kind, sets, "auto", "(solve :method dogleg)"),
    "gauss-newton": lambda kind, sets: alone(kind, sets, "auto", "(solve :method gauss-newton)"),
    "exact": lambda kind, sets: alone(kind, sets, "auto", "(solve :constraints exact)"),
    "ipopt": lambda kind, sets: alone(kind, sets, "casadi", "(solve :method ipopt)"),
}


def applies(path: str, kind: Kind) -> bool:
    """Whether a path is one for problems of a kind."""
    if path == "estimator":
        return kind.given is not None
    if path in ("members", "large"):
        return kind.scatters
    if path in ("exact", "ipopt"):
        return kind.equal is not None or kind.below is not None
    return True
