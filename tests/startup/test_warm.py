"""A second process takes what the first compiled: it answers the same, byte for byte, and compiles nothing."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from mbm import compiler
from mbm.api import load, loads
from mbm.cli.main import run
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from tests.startup.caches import forgotten, seeded

PROBLEMS = Path(__file__).parents[2] / "problems"
JSON = ("--json", "-", "--backend", "numpy")
"""NumPy needs no machine code, which would take longer to make than all else together."""

COMPILES = {"sympy", "casadi", "scipy", "lark", "mpmath", "matplotlib", "pandas"}


@dataclass(frozen=True)
class Call:
    """What a command line said, without the seconds it took, and whether it derived and differentiated anything."""

    status: int
    said: tuple[bytes, bytes]
    compiled: bool


Solver = Callable[..., Call]


@pytest.fixture(scope="module", autouse=True)
def _solver() -> None:
    """The solver's machine code is in the cache of the run."""
    loads("(problem p (unknowns (a :init 0)) (observe (= 1 a) :sigma 1))").solve(backend="numpy")


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]) -> Solver:
    """``solved(file, cache, option…)``: a call of ``mbm solve`` that holds nothing of earlier ones but the cache."""
    derivations: list[str] = []
    derived = compiler.derived

    def counted(found: Elaborated) -> KernelSet:
        derivations.append(found.problem.name)
        return derived(found)

    monkeypatch.setattr(compiler, "derived", counted)

    shared = Path(os.environ["MBM_CACHE"])

    def solve(file: Path, cache: Path | str, *more: str | Path) -> Call:
        if isinstance(cache, Path):
            seeded(cache, shared)
        monkeypatch.setenv("MBM_CACHE", str(cache))
        monkeypatch.chdir(file.parent)
        derivations.clear()
        capfdbinary.readouterr()
        status = run(["solve", str(file), *map(str, more or JSON)])
        sys.stdout.flush()
        said = capfdbinary.readouterr()
        shown = re.sub(rb'"seconds":[^,}]*', b'"seconds":0', said.out)
        if "-v" in more:  # the table says the time in a sentence, whose lines break elsewhere if it is longer
            shown = re.sub(rb"\S+ ms;", b"0 ms;", b" ".join(shown.split()))
        return Call(status=status, said=(shown, said.err), compiled=bool(derivations))

    return solve


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    return tmp_path / "cache"


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(PROBLEMS.glob("*/*.mbm")), ids=lambda file: file.stem)
def test_the_document_and_the_table_are_the_same(file: Path, solved: Solver) -> None:
    cache = Path(os.environ["MBM_CACHE"])
    for name in load(file).names:
        for more in (("--problem", name, "--json", "-"), ("--problem", name, "-v")):
            forgotten(cache)
            cold, warm = solved(file, cache, *more), solved(file, cache, *more)
            assert cold.compiled
            assert not warm.compiled
            assert (warm.said, warm.status) == (cold.said, cold.status)


LINE = """(problem line
  (constants (h 2))
  (data d (csv "d.csv"))
  (unknowns (a :init 0 :unit m) (b :init 0))
  (observe d (= y (+ a (* b x h))) :sigma 0.1))
"""
ROWS = "x,y\n1,2.1\n2,3.9\n3,6.2\n4,8.1\n"


@pytest.fixture
def line(tmp_path: Path) -> Path:
    (tmp_path / "d.csv").write_text(ROWS, encoding="utf-8")
    file = tmp_path / "line.mbm"
    file.write_text(LINE, encoding="utf-8")
    return file


def _loaded(code: str, file: Path, cache: Path) -> tuple[object, set[str]]:
    """What ``code`` leaves in ``answer``, in a process of its own, and the modules that it loads."""
    report = "import json, sys\n" + code + "\nprint(json.dumps([answer, sorted(sys.modules)]))"
    environment = {"MBM_CACHE": str(cache), "PATH": "", "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run([sys.executable, "-c", report, file], capture_output=True, env=environment, check=True)
    answer, modules = json.loads(done.stdout.splitlines()[-1])
    return answer, set(modules)


SELDOM = (
    *("concurrent.futures", "logging", "shutil", "tempfile", "traceback"),
    *("mbm.report.blocks", "mbm.report.document", "mbm.report.exports", "mbm.report.given_starts", "mbm.report.many"),
    *(
        "mbm.estimation.search.basins",
        "mbm.estimation.search.seeker",
        "mbm.solver.batch",
        "mbm.equations.windows",
    ),
    *(
        "mbm.estimation.batches",
        "mbm.estimation.minimise.native.fusing",
        "mbm.estimation.minimise.native.function",
        "mbm.text.render",
    ),
)
"""What one data set, one start and a table on a terminal do without; each of them takes part of a warm start."""


def test_a_warm_solve_of_one_data_set_loads_little(line: Path) -> None:
    pytest.importorskip("llvmlite")  # without machine code the methods in Python are loaded
    cache = Path(os.environ["MBM_CACHE"])
    before, after = "import sys; before = set(sys.modules)\n", "\nfor name in before: sys.modules.pop(name, None)"
    code = f"{before}from mbm.cli.main import run; answer = run(['solve', sys.argv[1]]); print(){after}"
    _loaded(code, line, cache)
    status, modules = _loaded(code, line, cache)
    assert status == 0
    assert "mbm.report.table" in modules
    assert not {name for name in modules if name in SELDOM or name.startswith(tuple(f"{name}." for name in SELDOM))}


BACKENDS = ("numpy", pytest.param("auto", marks=pytest.mark.slow))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_warm_solve_loads_nothing_that_compiles(backend: str, line: Path, cache: Path) -> None:
    call = f"['solve', sys.argv[1], '--json', '-', '--backend', '{backend}']"
    code = f"from mbm.cli.main import run; answer = run({call}); print()"
    _loaded(code, line, cache)
    status, modules = _loaded(code, line, cache)
    assert status == 0
    assert not {name.partition(".")[0] for name in modules} & COMPILES
    front = (
        "mbm.shapes",
        "mbm.language.vocabulary",
        "mbm.language.evaluator",
        "mbm.language.session",
        "mbm.problem.reading",
        "mbm.problem.builder",
        "mbm.symbolic.model",
    )
    assert not {name for name in modules if name.startswith(front)}


def test_a_warm_silhouette_loads_shapely_and_nothing_that_compiles(tmp_path: Path, cache: Path) -> None:
    file = tmp_path / "seen.mbm"
    file.write_text(
        "(problem seen (camera cam :focal 800) (unknowns (r :init 0.1))"
        " (observe (= 9000 (area (silhouette cam (trans [0 0 2] (sphere r))))) :sigma 1))",
        encoding="utf-8",
    )
    code = "from mbm.cli.main import run; answer = run(['solve', sys.argv[1], '--backend', 'numpy']); print()"
    _loaded(code, file, cache)
    status, modules = _loaded(code, file, cache)
    assert status == 0
    assert "shapely" in modules
    assert not {name.partition(".")[0] for name in modules} & COMPILES


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_warm_start_through_python_loads_nothing_that_compiles(backend: str, line: Path, cache: Path) -> None:
    code = (
        "import mbm; problem = mbm.load(sys.argv[1]);"
        f"first = problem.solve(backend='{backend}'); second = problem.compile(backend='{backend}').solve();"
        "answer = [float(first['a'].value), float(second['a'].value)]"
    )
    before, _ = _loaded(code, line, cache)
    after, modules = _loaded(code, line, cache)
    assert before == after
    assert not {name.partition(".")[0] for name in modules} & COMPILES


def test_without_a_cache_every_process_compiles_and_says_the_same(line: Path, cache: Path, solved: Solver) -> None:
    kept = solved(line, cache)
    off = solved(line, "off")
    assert off.compiled
    assert off.said == kept.said


def test_other_numbers_in_the_same_columns_need_no_compilation(
    line: Path, cache: Path, tmp_path: Path, solved: Solver
) -> None:
    solved(line, cache)
    other = tmp_path / "other.csv"
    other.write_text("x,y\n1,3.1\n2,4.9\n3,7.3\n", encoding="utf-8")
    warm, cold = (
        solved(line, cache, *JSON, "--data", "d=other.csv"),
        solved(line, tmp_path / "none", *JSON, "--data", "d=other.csv"),
    )
    assert not warm.compiled
    assert cold.compiled
    assert warm.said == cold.said


@pytest.mark.parametrize(
    ("old", "new"),
    [("(* b x h)", "(* b x x h)"), (":sigma 0.1", ":sigma 0.2"), (":unit m", ":unit mm"), ("(h 2)", "(h 3)")],
)
def test_another_text_is_compiled(old: str, new: str, line: Path, cache: Path, tmp_path: Path, solved: Solver) -> None:
    solved(line, cache)
    line.write_text(LINE.replace(old, new), encoding="utf-8")
    warm, cold = solved(line, cache), solved(line, tmp_path / "none")
    assert warm.compiled
    assert warm.said == cold.said


def test_constants_from_outside_are_part_of_what_is_kept(
    line: Path, cache: Path, tmp_path: Path, solved: Solver
) -> None:
    solved(line, cache)
    for more in (("--set", "h=3"), ("--set", "a=1m")):
        first, second = solved(line, cache, *JSON, *more), solved(line, cache, *JSON, *more)
        assert first.compiled
        assert not second.compiled
        assert first.said == second.said == solved(line, tmp_path / "none", *JSON, *more).said


@pytest.mark.parametrize(
    "rows",
    ["x,y,z\n1,2.1,7\n2,3.9,8\n3,6,9\n", "x,y\n1,two\n2,3\n3,4\n", "x,y\n1,2.1\n2,\n3,4\n", "x\n1\n2\n", "x,y\n", ""],
)
def test_other_columns_and_faulty_rows_are_treated_as_in_a_first_run(
    rows: str, line: Path, cache: Path, tmp_path: Path, solved: Solver
) -> None:
    solved(line, cache)
    (tmp_path / "d.csv").write_text(rows, encoding="utf-8")
    warm, cold = solved(line, cache), solved(line, tmp_path / "none")
    assert (warm.said, warm.status) == (cold.said, cold.status)


USED = "(defun double (x) (* 2 x))\n"


def test_files_that_are_used_are_looked_at(line: Path, cache: Path, tmp_path: Path, solved: Solver) -> None:
    used = tmp_path / "used.mbm"
    used.write_text(USED, encoding="utf-8")
    line.write_text('(use "used.mbm")\n' + LINE.replace("(* b x h)", "(* b (double x))"), encoding="utf-8")
    first, second = solved(line, cache), solved(line, cache)
    assert first.compiled
    assert not second.compiled
    assert first.said == second.said
    used.write_text(USED.replace("2", "3"), encoding="utf-8")
    third = solved(line, cache)
    assert third.compiled
    assert third.said != first.said
    used.unlink()
    assert b"missing-file" in solved(line, cache).said[1]


def test_a_file_that_is_used_is_not_read_outside_of_the_sandbox(
    line: Path, cache: Path, tmp_path: Path, solved: Solver
) -> None:
    inside, outside = tmp_path / "in", tmp_path / "out"
    for folder in (inside, outside):
        folder.mkdir()
        (folder / "used.mbm").write_text(USED, encoding="utf-8")
    (inside / "d.csv").write_text(ROWS, encoding="utf-8")
    file = inside / "line.mbm"
    file.write_text('(use "used.mbm")\n' + LINE, encoding="utf-8")
    assert solved(file, cache, *JSON, "--sandbox", inside).status == 0
    (inside / "used.mbm").unlink()
    (inside / "used.mbm").symlink_to(outside / "used.mbm")  # the same text, in another place
    assert b"outside-sandbox" in solved(file, cache, *JSON, "--sandbox", inside).said[1]


PARTS = """(problem parts
  (data d (csv "d.csv") {where})
  (unknowns (a :init 0) (b :init 0))
  (observe d (= y (if (= kind "left") (* a x) (* b x x))) :sigma 0.1 {when}))
"""
KINDS = "kind,x,y,good\nleft,1,2.1,1\nleft,2,3.9,1\nright,1,1.2,1\nright,2,3.9,0\nright,3,9.1,1\n"


@pytest.mark.parametrize(
    ("options", "rows", "compiles"),
    [
        ({}, KINDS.replace("2.1", "2.2"), False),
        ({}, KINDS + "left,3,6.2,1\n", False),
        ({}, KINDS.replace("left", "middle"), True),
        ({}, "\n".join([KINDS.splitlines()[0], *reversed(KINDS.splitlines()[1:])]), True),
        ({"when": ":when (= good 1)"}, KINDS.replace("3.9,0", "4.1,0"), False),
        (
            {"when": ":when (= good 1)"},
            KINDS.replace("left,1,2.1,1", "left,1,2.1,0").replace("left,2,3.9,1", "left,2,3.9,0"),
            True,
        ),
        ({"where": ':where (= kind "right")'}, KINDS.replace("2.1", "2.2"), False),
        ({"where": ':where (= kind "right")'}, KINDS + "middle,1,2,1\n", True),
    ],
)
def test_where_values_decide_the_equations_they_are_compared(
    options: dict[str, str], rows: str, compiles: bool, tmp_path: Path, cache: Path, solved: Solver
) -> None:
    data, file = tmp_path / "d.csv", tmp_path / "parts.mbm"
    file.write_text(PARTS.format(**{"where": "", "when": "", **options}), encoding="utf-8")
    data.write_text(KINDS, encoding="utf-8")
    first = solved(file, cache)
    data.write_text(rows, encoding="utf-8")
    warm, cold = solved(file, cache), solved(file, tmp_path / "none")
    assert (warm.said, warm.status) == (cold.said, cold.status)
    assert warm.compiled == compiles
    data.write_text(KINDS, encoding="utf-8")
    back = solved(file, cache)
    assert not back.compiled
    assert back.said == first.said


def test_a_member_named_by_its_key_must_still_be_there(tmp_path: Path, cache: Path, solved: Solver) -> None:
    data, file = tmp_path / "d.csv", tmp_path / "f.mbm"
    file.write_text(
        '(problem f (data d (csv "d.csv")) (unknowns (o :per d.s :init 0))'
        ' (observe d (= y (o s)) :sigma 0.1) (constraints (= (o "a") 0)))',
        encoding="utf-8",
    )
    data.write_text("s,y\na,0.1\nb,1\nb,1.1\n", encoding="utf-8")
    assert solved(file, cache).status == 0
    data.write_text("s,y\nc,0.1\nb,1\nb,1.1\n", encoding="utf-8")
    warm, cold = solved(file, cache), solved(file, tmp_path / "none")
    assert (warm.said, warm.status) == (cold.said, cold.status)
    assert warm.status == 2


def test_a_demand_on_data_is_decided_for_each_data_set(tmp_path: Path, cache: Path, solved: Solver) -> None:
    data, file = tmp_path / "d.csv", tmp_path / "f.mbm"
    file.write_text(
        '(problem f (data d (csv "d.csv")) (unknowns (a :init 0))'
        " (observe d (= y a) :sigma 0.1) (constraints (< y 5 :over d)))",
        encoding="utf-8",
    )
    data.write_text("y\n1\n2\n", encoding="utf-8")
    assert solved(file, cache).status == 0
    data.write_text("y\n1\n6\n", encoding="utf-8")
    warm, cold = solved(file, cache), solved(file, tmp_path / "none")
    assert (warm.said, warm.status) == (cold.said, cold.status)
    assert warm.status == 2


def test_warnings_about_the_text_and_about_the_data_stay_where_they_belong(
    tmp_path: Path, cache: Path, solved: Solver
) -> None:
    data, file = tmp_path / "d.csv", tmp_path / "f.mbm"
    file.write_text(
        '(problem f (data d (csv "d.csv")) (unknowns (a :init 0) (b :init 0))'
        " (observe d (= y a) :sigma 0.1) (observe far d (= y (+ a b)) :sigma 0.1 :when (> x 10)))",
        encoding="utf-8",
    )
    empty, full = "x,y\n1,1\n2,2\n", "x,y\n1,1\n12,2\n"
    for before, now in ((empty, full), (full, empty)):
        own = tmp_path / f"cache{len(before)}"
        data.write_text(before, encoding="utf-8")
        solved(file, own)
        data.write_text(now, encoding="utf-8")
        warm, cold = solved(file, own), solved(file, tmp_path / "none" / str(len(before)))
        assert not warm.compiled
        assert (warm.said, warm.status) == (cold.said, cold.status)
        assert (b"no-rows" in warm.said[1]) == (now == empty)


def test_what_cannot_be_trusted_is_compiled_again(line: Path, cache: Path, solved: Solver) -> None:
    first = solved(line, cache)
    for path in cache.glob("*/*.entry"):
        path.write_bytes(path.read_bytes()[:-3])
    second, third = solved(line, cache), solved(line, cache)
    assert second.compiled
    assert not third.compiled
    assert first.said == second.said == third.said
