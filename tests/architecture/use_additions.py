"""Solves with the additions in every way, in a process whose mbm has them; prints what comes out as JSON."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

import mbm
from mbm.cli.main import run

CURVE = """(problem curve
  (data d (semicolons "curve.semicolons") :where (= run 1))
  (unknowns (a :init 1) (b :init 3) (c :init 0.1))
  (observe d (= y (+ (* a (erf (* b x))) (* c (softplus x)) (erf 0.5))) :sigma (+ 0.1 (erf x)))
  (solve :method METHOD))"""
PLACE = """(problem place
  (data d (semicolons "place.semicolons") :where (= run 1))
  (unknowns (m :init 0))
  (observe d (= y m) :sigma 0.1 :loss (welsch 2)))"""
ROOTS = "(problem roots (data d external) (unknowns (f :per d.k :init 1)) (observe d (= y (^ (f k) 3)) :sigma 1))"

Numbers = dict[str, Any]


def for_each(text: str) -> str:
    """The problem for each run, in place of the first."""
    return text.replace(" :where (= run 1)", "")[:-1] + " (for-each run))"


def written() -> None:
    """The data: curves without noise for known numbers, and places with one value that is far off."""
    x = np.linspace(0.1, 3.0, 25)
    lines = ["run;x;y"]
    for key, (a, b, c) in enumerate([(2.0, 0.7, 0.5), (3.0, 0.5, -0.25)], start=1):
        y = [a * math.erf(b * t) + c * math.log1p(math.exp(t)) + math.erf(0.5) for t in x]
        lines += [f"{key};{t!r};{v!r}" for t, v in zip(x.tolist(), y, strict=True)]
    Path("curve.semicolons").write_text("\n".join(lines), "utf-8")
    places = [(1, y) for y in (0.0, 0.11, -0.07, 0.3, 0.45, 4.0)] + [(2, y) for y in (1.0, 1.2, 0.9, 1.05, 1.7)]
    Path("place.semicolons").write_text("\n".join(["run;y", *(f"{key};{y}" for key, y in places)]), "utf-8")


def values(solution: Any) -> list[list[float]]:
    """The estimates of each solve."""
    return [[float(each.value) for each in solve.estimates] for solve in solution.solves]


def generated(name: str, target: str) -> list[float]:
    """The estimates of a generated solver for the data that go with it."""
    folder = Path(f"{name}-{target}")
    if run(["compile", f"{name}.mbm", "--target", target, "-o", str(folder)]) != 0:
        raise SystemExit(folder.name)
    if target == "c":
        call(folder, "make", name, "CFLAGS=-O0")
    solver = [f"./{name}"] if target == "c" else [sys.executable, f"{name}.py"]
    lines = call(folder, *solver, "data/d.csv").splitlines()
    return [float(line.split(",")[1]) for line in lines if line.split(",")[0] in ("a", "b", "c", "m")]


def call(folder: Path, *command: str) -> str:
    """What a command prints; 1 says that its answer has something doubtful."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode > 1:
        raise SystemExit(done.stderr)
    return done.stdout


def main() -> None:
    """Everything."""
    written()
    found: Numbers = {}
    for name, text in (("curve", CURVE.replace("METHOD", "halfway")), ("place", PLACE)):
        for backend in ("native", "casadi", "numpy"):
            found[f"{name} {backend}"] = values(mbm.loads(text).compile(backend=backend).solve())
        found[f"{name} for-each"] = values(mbm.loads(for_each(text)).solve())
        Path(f"{name}.mbm").write_text(text, "utf-8")
        for target in ("c", "python"):
            found[f"{name} {target}"] = [generated(name, target)]
    found["words"] = Path("curve-c/README.md").read_text("utf-8")
    for name in ("curve", "place"):
        Path("runs.mbm").write_text(for_each(Path(f"{name}.mbm").read_text("utf-8")), "utf-8")
        for file in (name, "runs"):
            run(["solve", f"{file}.mbm", "--json", f"{file}.json", "--csv", f"{file}.csv"])
            solves = json.loads(Path(f"{file}.json").read_text("utf-8"))["solves"]
            with Path(f"{file}.csv").open(encoding="utf-8", newline="") as stream:
                cells = [row["norm"] for row in csv.DictReader(stream)]
            found[f"norms {name} {file}"] = [[solve["cost"], solve["norm"]] for solve in solves], cells
    for method in ("halfway", "gauss-newton"):
        first = mbm.loads(CURVE.replace("METHOD", method)).solve().first
        found[method] = [first.method, first.iterations]
    many = {"k": np.arange(400.0), "y": np.linspace(1.0, 8.0, 400)}
    roots = mbm.loads(ROOTS).solve(data={"d": many}, method="halfway")
    found["roots"] = roots["f"].value.tolist()
    found["sparse"] = roots.first.method
    found["source"] = mbm.__file__
    print(json.dumps(found))


if __name__ == "__main__":
    main()
