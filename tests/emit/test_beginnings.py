"""``mbm compile --init``: generated solvers that begin where they are told, members of families one by one."""

from __future__ import annotations

import json
import sys
from math import sin
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.cli.main import run
from mbm.equations.manifolds import numbers_of_stated
from mbm.problem.types import UnknownKind
from mbm.report.beginnings import stated_of_numbers
from tests.emit.making import make, of_text, run as called, written

GROWTH = """
(problem growth (data plants (table (id kind) ("a" 1) ("b" 2) ("c" 1)) :key id)
  (data d (table (who day y) ("a" 1 2.1) ("b" 1 3.2) ("c" 1 4.1) ("a" 2 2.6) ("b" 2 3.4) ("c" 2 4.7)))
  (unknowns (g :per plants) (o :per d.day) (k))
  (observe d (= y (+ (exp (* 0.3 (g who))) (o day) k)) :sigma 0.1)
  (constraints (normal k 0 1) (normal (o day) 0 1 :over d)){more})
"""
POSES = """
(problem views (data cameras (table (id) ("l") ("r")) :key id)
  (data d (table (cam x y z u v) {rows}))
  (camera eye :model pinhole :focal (500 500) :center (0 0))
  (unknowns (T (pose 3) :per cameras))
  (observe d (= [u v] (project eye (transform (T cam) [x y z]))) :sigma 0.5))
"""


def compiled(folder: Path, text: str, init: object, target: str) -> Path:
    """The folder with the solver of a problem that begins at some values."""
    (folder / "p.mbm").write_text(text, encoding="utf-8")
    (folder / "init.json").write_text(json.dumps(init), encoding="utf-8")
    at = ["--init", str(folder / "init.json")]
    assert run(["compile", str(folder / "p.mbm"), "--target", target, "-o", str(folder / "solver"), "-q", *at]) == 0
    return folder / "solver"


def document_of(text: str) -> object:
    """The result document of a problem."""
    return json.loads(mbm.loads(text).solve().to_json())


def refusal(folder: Path, text: str, init: object, capsys: pytest.CaptureFixture[str]) -> str:
    (folder / "p.mbm").write_text(text, encoding="utf-8")
    (folder / "init.json").write_text(json.dumps(init), encoding="utf-8")
    at = ["--init", str(folder / "init.json")]
    assert run(["compile", str(folder / "p.mbm"), "--target", "c", "-o", str(folder / "solver"), *at]) == 2
    return capsys.readouterr().err


def rows_of_views() -> str:
    """Images of twelve points in two cameras."""
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (12, 3))
    lines = []
    for name, angles, shift in (("l", [0.1, 0.2, -0.3], [0.0, 0.1, 5.0]), ("r", [-0.2, 0.4, 2.5], [0.3, 0.0, 6.0])):
        x, y, z = (Rotation.from_euler("xyz", angles).apply(points) + shift).T
        for point, u, v in zip(points, 500 * x / z, 500 * y / z, strict=True):
            lines.append(f'("{name}" {" ".join(f"{number:.6f}" for number in [*point, u, v])})')
    return " ".join(lines)


def test_families_begin_at_a_solved_answer_in_c_and_python(tmp_path: Path) -> None:
    text = GROWTH.format(more="")
    answer = document_of(text)
    for target in ("c", "python"):
        (tmp_path / target).mkdir()
        folder = compiled(tmp_path / target, text, answer, target)
        if target == "c":
            made = make(folder, "test", watched=False)
            assert made.returncode == 0, made.stdout + made.stderr
        else:
            done = called("python", "test_growth.py", folder=folder)
            assert done.returncode == 0, done.stdout + done.stderr


def test_members_of_other_data_begin_where_their_table_says(tmp_path: Path) -> None:
    text = GROWTH.format(more="")
    folder = compiled(tmp_path, text, document_of(text), "python")
    table = folder / "data" / "plants.csv"
    assert table.read_text(encoding="utf-8").splitlines()[0] == "id,g start"
    with table.open("a", encoding="utf-8") as lines:
        lines.write("e,5.0\n")
    with (folder / "data" / "d.csv").open("a", encoding="utf-8") as lines:
        lines.write("e,1.0,7.0\ne,2.0,7.4\n")
    done = called("python", "growth.py", "data/plants.csv", "data/d.csv", folder=folder)
    assert done.returncode == 0, done.stderr
    more = text.replace('("c" 1)) :key', '("c" 1) ("e" 1)) :key').replace("2 4.7)", '2 4.7) ("e" 1 7.0) ("e" 2 7.4)')
    member = float(mbm.loads(more).solve()["g"].value[3])
    found = next(line.split(",")[1] for line in done.stdout.splitlines() if line.startswith("g[e],"))
    # Both end within 1e-9 standard deviations (0.5) of one minimum.
    assert float(found) == pytest.approx(member, abs=1e-9)


def test_poses_begin_at_a_solved_answer(tmp_path: Path) -> None:
    text = POSES.format(rows=rows_of_views())
    folder = compiled(tmp_path, text, document_of(text), "python")
    done = called("python", "test_views.py", folder=folder)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("kind", "dimension", "size"),
    [
        (UnknownKind.ROTATION, 2, 1),
        (UnknownKind.POSE, 2, 3),
        (UnknownKind.ROTATION, 3, 4),
        (UnknownKind.POSE, 3, 7),
        (UnknownKind.SIMILARITY, 3, 8),
        (UnknownKind.DIRECTION, 3, 3),
    ],
)
def test_what_is_stated_is_held_by_the_same_numbers(kind: UnknownKind, dimension: int, size: int) -> None:
    random = np.random.default_rng(3)
    numbers = random.uniform(0.1, 1.0, (5, size))
    held = 4 if dimension == 3 and kind is not UnknownKind.DIRECTION else size if kind is UnknownKind.DIRECTION else 1
    if held > 1:
        numbers[:, :held] /= np.linalg.norm(numbers[:, :held], axis=1, keepdims=True)
    word = "direction" if kind is UnknownKind.DIRECTION else f"({kind.value} {dimension})"
    text = f"(problem p (unknowns (a {word})) (observe (= 0 1) :sigma 1))"
    unknown = next(u for u in mbm.loads(text).compile().elaborated.problem.unknowns)
    assert unknown.size == size
    # Rounding of a matrix made of a quaternion and back.
    np.testing.assert_allclose(
        numbers_of_stated(kind, dimension, stated_of_numbers(unknown, numbers)), numbers, rtol=0, atol=1e-14
    )


HELD = """(problem held (data frames (table (frame) (1) (2) (3)) :key frame)
  (data seen (table (frame a b x y)
    (1 0 0 1.1 2) (1 1 0 1 3) (2 0 0 3 -1) (2 1 0 3.9 -1.3) (3 0 0 -2 0.6) (3 1 0 -3 0.8)))
  (unknowns (T (pose 2) :per {per} {init} :fixed (= frame 1) :at (pose2 1 2 90deg)))
  (observe seen (= [x y] (transform (T frame) [a b])) :sigma 0.1))"""


@pytest.mark.parametrize("target", ["c", "python"])
def test_members_are_held_where_it_is_said(tmp_path: Path, target: str) -> None:
    """Generated solvers carry the reference's answer, in which frame 1 is held, and compare with it."""
    (tmp_path / "p.mbm").write_text(HELD.format(per="frames", init=":init (pose2 0 0 0)"), encoding="utf-8")
    folder = tmp_path / "solver"
    assert run(["compile", str(tmp_path / "p.mbm"), "--target", target, "-o", str(folder), "-q"]) == 0
    done = make(folder, "test") if target == "c" else called("python", "test_held.py", folder=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    value = mbm.loads((tmp_path / "p.mbm").read_text(encoding="utf-8")).solve()["T"].value[0]
    np.testing.assert_allclose(value, [np.pi / 2, 1, 2], rtol=1e-15)


@pytest.mark.parametrize(
    ("per", "init", "words"),
    [("frames", "", "without a start"), ("(seen.frame frames.frame)", ":init (pose2 0 0 0)", "over several columns")],
)
def test_what_generated_solvers_cannot_hold_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], per: str, init: str, words: str
) -> None:
    (tmp_path / "p.mbm").write_text(HELD.format(per=per, init=init), encoding="utf-8")
    assert run(["compile", str(tmp_path / "p.mbm"), "--target", "c", "-o", str(tmp_path / "solver")]) == 2
    assert words in capsys.readouterr().err


def test_one_value_serves_all_solves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = """(problem p (data d (table (run x y) (1 0 1) (1 1 2.8) (2 0 2) (2 1 5.3)))
      (unknowns (a) (b)) (observe d (= y (* a (exp (* b x)))) :sigma 0.1) (for-each run))"""
    folder = compiled(tmp_path, text, {"a": 1.5, "b": 1.0}, "python")
    done = called("python", "test_p.py", folder=folder)
    assert done.returncode == 0, done.stdout + done.stderr
    both = {"mbm": "x", "solves": [{"key": {"run": r}, "estimates": {"a": {"value": r}}} for r in (1, 2)]}
    assert "the solves of `for-each` begin at different values" in refusal(tmp_path, text, both, capsys)


def test_every_member_or_none_has_a_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = GROWTH.format(more="")
    told = refusal(tmp_path, text, {"g": {"keys": ["a", "b"], "value": [1.0, 2.0]}, "o": [0.0, 0.0]}, capsys)
    assert 'error[not-emitted]: `--init` without `g["c"]` cannot be compiled' in told
    assert "give a value for every member, or for none" in told
    assert "error[bad-initial-values]" in refusal(tmp_path, text, {"nobody": 1.0}, capsys)


@pytest.mark.parametrize(("target", "command"), [("c", ("./tone",)), ("python", (sys.executable, "tone.py"))])
@pytest.mark.parametrize("range_of", [":in [0.2 9]", ":start (0.2 9)"])
def test_a_range_is_no_start(target: str, command: tuple[str, ...], range_of: str, tmp_path: Path) -> None:
    """The data are sines of the time, rounded to a thousandth; from the middle of the range, 4.6, steps end there."""
    rows = " ".join(f"({t} {sin(t):.3f})" for t in range(8))
    text = f"""(problem tone (data d (table (t y) {rows}))
      (unknowns (w {range_of})) (observe d (= y (sin (* w t))) :sigma 0.01))"""
    folder = written(of_text(text, target), tmp_path)
    if target == "c":
        assert make(folder, "all").returncode == 0
    answer = called(*command, "data/d.csv", folder=folder).stdout.splitlines()[1].split(",")
    assert abs(float(answer[1]) - 1.0) < 3.0 * float(answer[2])
    assert "begins at the answer" in (folder / "README.md").read_text(encoding="utf-8")


def test_a_column_that_is_called_as_a_start_is_left_alone(tmp_path: Path) -> None:
    text = """(problem p (data m (csv "m.csv") :key id :columns ((offset "g start")))
      (data d (table (who y) ("a" 2.1) ("b" 3.2)) :with (m who))
      (unknowns (g :per m)) (observe d (= y (+ (g who) m.offset)) :sigma 0.1))"""
    (tmp_path / "m.csv").write_text("id,g start\na,7\nb,8\n", encoding="utf-8")
    folder = compiled(tmp_path, text, {"g": {"keys": ["a", "b"], "value": [1.0, 2.0]}}, "python")
    assert (folder / "data" / "m.csv").read_text(encoding="utf-8").splitlines()[0] == "g start,id,the g start"
    done = called("python", "test_p.py", folder=folder)
    assert done.returncode == 0, done.stdout + done.stderr
