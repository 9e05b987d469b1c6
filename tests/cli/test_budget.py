"""``mbm budget``: the table, the files it writes, and what it refuses."""

from __future__ import annotations

import csv
import json

import pytest

from mbm.cli.main import run

PENDULUM = """(problem pendulum (constants (l 1.000m :sigma 1mm))
  (data d (table (period) (2.0063) (2.0059) (2.0066) (2.0061))) (unknowns (g :init 10m/s^2))
  (observe d (= period (* 2 pi (sqrt (/ l g)))) :sigma unknown) (derive (twice (* 2 g))))"""
ODD = """(problem odd (data d (table (@x y) (1 2) (2 3.9) (3 6.1))) (unknowns (=b))
  (observe =d d (= y (* =b @x)) :sigma 0.1))"""


@pytest.fixture
def pendulum(tmp_path):
    """The file of a problem."""
    file = tmp_path / "pendulum.mbm"
    file.write_text(PENDULUM)
    return file


def test_the_table_has_a_line_for_each_input(pendulum, capsys):
    assert run(["budget", str(pendulum), "--for", "g"]) == 0
    told = capsys.readouterr().out
    assert told.startswith("budget of g = 9.8085 ± 0.0099 m/s^2\n")
    lines = [line.split() for line in told.splitlines() if "%" in line and "u =" not in line]
    assert [(line[0], line[1], line[2], line[-3]) for line in lines] == [
        ("d", "rows", "4", "2.2"),
        ("l", "constant", "1", "97.8"),
    ]


def test_files_hold_the_same_numbers(pendulum, tmp_path, capsys):
    paths = {ending: tmp_path / f"b.{ending}" for ending in ("csv", "json", "tex", "svg")}
    asked = ["--csv", str(paths["csv"]), "--json", str(paths["json"]), "--latex", str(paths["tex"])]
    assert run(["budget", str(pendulum), *asked, "--plot", str(paths["svg"])]) == 0
    solve = json.loads(paths["json"].read_text())["solves"][0]
    assert solve["budget"] == solve["budgets"][0]
    assert [budget["quantity"] for budget in solve["budgets"]] == ["g", "twice"]
    own = solve["budget"]
    assert own["value"] == solve["estimates"]["g"]["value"]
    assert own["sigma"] == solve["estimates"]["g"]["sigma"]
    assert own["dof"] == solve["estimates"]["g"]["dof"]
    assert sum(row["contribution"] ** 2 for row in own["rows"]) == pytest.approx(own["sigma"] ** 2, rel=1e-10)
    assert [row["dof"] for row in own["rows"]] == [3.0, None]
    with paths["csv"].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["kind"] for row in rows] == ["rows", "constant", "combined"] * 2
    assert [float(row["contribution"]) for row in rows[:2]] == [row["contribution"] for row in own["rows"]]
    assert paths["tex"].read_text().count(r"\begin{tabular}") == 2
    assert "<svg" in paths["svg"].read_text()


def test_the_document_goes_to_standard_output(pendulum, capsys):
    assert run(["budget", str(pendulum), "--json", "-", "--rows", "--for", "twice", "--set", "l=99cm"]) == 0
    budget = json.loads(capsys.readouterr().out)["solves"][0]["budget"]
    assert [row["row"] for row in budget["rows"]] == [1, 2, 3, 4, None]
    assert budget["rows"][-1]["value"] == pytest.approx(990.0)


def test_names_of_a_file_are_no_formulas_and_no_commands(tmp_path, capsys):
    file, table, tex = tmp_path / "odd.mbm", tmp_path / "b.csv", tmp_path / "b.tex"
    file.write_text(ODD.replace("=d d", "a_b&% d"))
    assert run(["budget", str(file), "--latex", str(tex)]) == 0
    assert r"a\_b\&\%" in tex.read_text()
    file.write_text(ODD)
    assert run(["budget", str(file), "--csv", str(table)]) == 0
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert rows[0]["quantity"] == "'=b"
    assert rows[0]["input"] == "'=d"


def test_keys_that_are_escape_sequences_stay_texts(tmp_path, capsys):
    file, table = tmp_path / "p.mbm", tmp_path / "d.csv"
    table.write_text("k,y\n\x1b[31mred,1\n\x1b[31mred,2\n")
    file.write_text('(problem p (data d (csv "d.csv")) (unknowns (m :per d.k)) (observe d (= y (m k)) :sigma 1))')
    assert run(["budget", str(file)]) == 0
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (["--for", "G"], "unknown-quantity"),
        (["--for", "g", "--plot", "b.gif"], "plot-format"),
        (["--problem", "other"], "unknown-problem"),
    ],
)
def test_what_is_refused(pendulum, asked, code, capsys):
    assert run(["budget", str(pendulum), *asked]) == 2
    told = capsys.readouterr()
    assert code in told.err
    assert not told.out


def test_the_problem_file_is_not_overwritten(pendulum, capsys):
    assert run(["budget", str(pendulum), "--csv", str(pendulum)]) == 2
    assert pendulum.read_text() == PENDULUM


def test_an_answer_in_doubt_has_the_exit_status_of_a_solve(tmp_path, capsys):
    file = tmp_path / "p.mbm"
    file.write_text(
        "(problem p (data d (table (x y) (1 2) (2 3.9))) (unknowns (a) (b) (c)) (observe d (= y (* a x)) :sigma 0.1)"
        "(observe (= 1 (+ b c)) :sigma 0.1))"
    )
    assert run(["budget", str(file)]) == 1
    assert capsys.readouterr().out.count("budget of") == 1
