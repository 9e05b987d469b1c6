"""Tables end to end: `(union A B …)` and paths with a pattern, and all that a table can do afterwards."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.cli.main import run
from mbm.data.union.tables import MOST_MATCHES
from mbm.text.types import MbmError

LINE = "(unknowns (a :init 0)) (observe d (= y a) :sigma 1)"
EXACT = 1e-12
"""Linear problems are solved in one step; a dozen roundings remain."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "A2.csv").write_text("x,y\n1,10\n2,20\n")
    (tmp_path / "A10.csv").write_text("y,x\n30,3\n")
    (tmp_path / "B1.csv").write_text("x,y\n4,40\n")
    return tmp_path


def solved(folder, text, **options):
    return mbm.loads(text, base=Path()).solve(**options)


def raised(folder, text):
    with pytest.raises(MbmError) as caught:
        solved(folder, text)
    return caught.value.diagnostics


def cells(folder, source, options="", more=""):
    """The columns x, y and row of the table d, and each row's source, as the equations see them."""
    text = f"""(problem p {more} (data d {source} {options})
      (unknowns (a :per d.source :init 0))
      (observe d (= y (a source)) :sigma 1)
      (derive (cells [x y row] :over d)))"""
    result = solved(folder, text)
    return np.asarray(result["cells"].value).tolist(), list(result["a"].keys)


def test_files_that_fit_stand_in_the_order_of_their_names_and_rows_count_through(folder):
    found, sources = cells(folder, '(csv "A*.csv")')
    assert found == [[3, 30, 1], [1, 10, 2], [2, 20, 3]]  # "A10" comes before "A2"; columns go by name
    assert sources == ["A10", "A2"]
    assert cells(folder, '(csv "?1.csv")') == ([[4, 40, 1]], ["B1"])


def test_tables_of_a_union_stand_in_the_order_in_which_it_names_them(folder):
    tables = '(data second (csv "A10.csv")) (data first (table (x y) (7 70) (8 80)))'
    assert cells(folder, "(union second first)", more=tables) == (
        [[3, 30, 1], [7, 70, 2], [8, 80, 3]],
        ["second", "first"],
    )


def test_options_of_the_clause_act_on_the_whole(folder):
    assert cells(folder, '(csv "A*.csv")', ":where (> x 1)") == ([[3, 30, 1], [2, 20, 3]], ["A10", "A2"])
    keyed = """(problem p (data k (csv "A*.csv") :key x) (data d (table (n z) (3 31) (1 12)) :with (k n))
      (unknowns (a :init 0)) (observe d (= z (+ a k.y)) :sigma 1))"""
    assert float(solved(folder, keyed)["a"].value) == pytest.approx((31 - 30 + 12 - 10) / 2, rel=EXACT)
    joined = """(problem p (data k (table (source w) (A2 5) (A10 7)) :key source)
      (data d (csv "A*.csv") :with (k source)) (unknowns (a :init 0)) (observe d (= k.w a) :sigma 1))"""
    assert float(solved(folder, joined)["a"].value) == pytest.approx((5 + 5 + 7) / 3, rel=EXACT)


def test_each_source_is_a_problem_of_its_own(folder):
    result = solved(folder, f'(problem p (data d (csv "A*.csv")) (for-each source) {LINE})')
    assert [solve.key for solve in result.solves] == [{"source": "A10"}, {"source": "A2"}]
    assert list(result.table()["a"]) == pytest.approx([30, 15], rel=EXACT)


def test_units_of_the_tables_hold_in_the_union(folder):
    text = """(problem p (data m (table (l) (2mm))) (data n (csv "B1.csv") :columns ((l x :unit cm)))
      (data d (union m o)) (data o (csv "B1.csv") :columns ((l x :unit cm)) :missing skip)
      (unknowns (a :unit mm)) (observe d (= l a) :sigma 1mm))"""
    with pytest.raises(MbmError, match="has a column `y`"):
        solved(folder, text)
    (folder / "l.csv").write_text("l\n4\n")
    text = """(problem p (data m (table (l) (2mm))) (data o (csv "l.csv") :columns ((l :unit cm)))
      (data d (union m o)) (unknowns (a :unit mm)) (observe d (= l a) :sigma 1mm))"""
    assert float(solved(folder, text)["a"].value) == pytest.approx(21, rel=EXACT)


def test_a_column_that_is_empty_in_one_file_is_what_it_is_in_the_other(folder):
    (folder / "A2.csv").write_text("x,y,name\n1,10,\n2,20,\n")
    (folder / "A10.csv").write_text("x,y,name\n3,30,far\n")
    text = '(problem p (data d (csv "A*.csv") :where (= name "far")) (unknowns (a)) (observe d (= y a) :sigma 1))'
    assert float(solved(folder, text)["a"].value) == pytest.approx(30, rel=EXACT)


def test_faults_name_the_file_and_the_row_there(folder):
    (folder / "A2.csv").write_text("x,y\n1,10\n2,nan\n")
    (fault,) = raised(folder, f'(problem p (data d (csv "A*.csv")) {LINE})')
    assert (fault.code.name, fault.place.file, fault.place.row, fault.place.column) == (
        "not-finite-cell",
        "A2.csv",
        3,
        "y",
    )
    (fault,) = raised(folder, f'(problem p (data d (csv "A*.csv") :columns ((z y) (y x)) :key z) {LINE})')
    assert (fault.code.name, fault.place.file, fault.place.row, fault.place.column) == ("missing-key", "A2.csv", 3, "y")
    (folder / "A2.csv").write_text("x,y\n3,10\n2,1\n")
    (fault,) = raised(folder, f'(problem p (data d (csv "A*.csv") :key x) {LINE})')
    assert fault.message == "row 2 of `A10.csv` and row 2 of `A2.csv` have the same key `3` in column `x`"
    (fault,) = raised(
        folder, f'(problem p (data s (csv "A10.csv")) (data t (table (x y) (5 1))) (data d (union s t) :key q) {LINE})'
    )
    assert "`<d>` has no column `q`" in fault.message


def test_a_dangling_key_and_a_paired_row_are_told_by_their_file(folder):
    (fault,) = raised(
        folder, f'(problem p (data k (table (n) (1) (2))  :key n) (data d (csv "A*.csv") :with (k x)) {LINE})'
    )
    assert (fault.place.file, fault.place.row) == ("A10.csv", 2)
    (folder / "A2.csv").write_text("x,y\n1,10\n2,nan\n")
    text = """(problem p (data d (csv "A*.csv")) (data e (csv "B1.csv")) (pair q (d e) :by x :tolerance 10)
      (unknowns (a)) (observe q (= d.y a) :sigma 1))"""
    (folder / "B1.csv").write_text("x,y\n2,40\n")
    (fault,) = raised(folder, text)
    assert (fault.place.file, fault.place.row, fault.place.column) == ("A2.csv", 3, "y")


def test_outliers_and_inputs_are_told_by_file(folder, capsys):
    (folder / "A2.csv").write_text("x,y\n" + "1,10\n" * 9 + "1,99\n")
    (folder / "A10.csv").write_text("x,y\n1,-50\n1,10\n")
    (folder / "p.mbm").write_text(f'(problem p (data d (csv "A*.csv")) {LINE} (solve :robust (lmeds)))')
    run(["solve", "p.mbm", "--json", "out.json"])
    said = capsys.readouterr().out
    assert "outliers: rows 1, 12 (row 2 of A10.csv, row 11 of A2.csv)" in " ".join(said.split())
    document = json.loads((folder / "out.json").read_text())
    assert [(each["path"], each["rows"]) for each in document["inputs"]] == [("A10.csv", 2), ("A2.csv", 10)]


def test_no_result_goes_onto_a_file_that_fits(folder, capsys):
    (folder / "p.mbm").write_text(f'(problem p (data d (csv "A*.csv")) {LINE})')
    before = (folder / "A2.csv").read_bytes()
    assert run(["solve", "p.mbm", "--csv", "A2.csv"]) == 2
    assert "would-overwrite" in capsys.readouterr().err
    assert (folder / "A2.csv").read_bytes() == before
    assert run(["solve", "p.mbm", "--data", "d=B1.csv", "--csv", "A2.csv"]) == 2  # what the clause names stays, too
    assert (folder / "A2.csv").read_bytes() == before


def test_a_pattern_and_other_members_come_from_outside(folder, capsys):
    (folder / "p.mbm").write_text(
        f"(problem p (data e external) (data f (table (x y) (9 90))) (data d (union e f)) {LINE})"
    )
    assert run(["solve", "p.mbm", "--data", "e=A2.csv", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["solves"][0]["estimates"]["a"]["value"] == pytest.approx(40, rel=EXACT)
    assert run(["solve", "p.mbm", "--data", "d=B*.csv", "--data", "e=B1.csv", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["solves"][0]["estimates"]["a"]["value"] == pytest.approx(40, rel=EXACT)
    compiled = mbm.load(folder / "p.mbm").compile()
    for y in (10.0, 50.0):
        assert float(compiled.solve(data={"e": {"x": [1.0], "y": [y]}})["a"].value) == pytest.approx(
            (y + 90) / 2, rel=EXACT
        )


def test_what_is_wrong_with_a_member_is_said_once(folder):
    faults = raised(folder, f'(problem p (data e (csv "none.csv")) (data d (union e)) {LINE})')
    assert [fault.code.name for fault in faults] == ["missing-file"]


def test_names_with_brackets_are_names_and_hidden_files_do_not_fit(folder):
    (folder / "C[1].csv").write_text("x,y\n1,1\n")
    (folder / "C1.csv").write_text("x,y\n1,2\n")
    (folder / ".C[1].csv").write_text("x,y\n1,3\n")
    assert cells(folder, '(csv "C[1]*.csv")')[0] == [[1, 1, 1]]
    assert cells(folder, '(csv "*C[1].csv")')[0] == [[1, 1, 1]]
    assert cells(folder, '(csv ".C*.csv")')[0] == [[1, 3, 1]]


def test_a_folder_whose_own_name_holds_a_star_is_no_pattern(tmp_path, monkeypatch):
    place = tmp_path / "what?*"
    place.mkdir()
    (place / "d.csv").write_text("x,y\n1,2\n")
    (place / "p.mbm").write_text(f'(problem p (data d (csv "d.csv")) {LINE})')
    assert float(mbm.load(place / "p.mbm").solve()["a"].value) == pytest.approx(2, rel=EXACT)


def test_graphs_are_put_end_to_end_without_a_key(folder):
    for name in ("g1", "g2"):
        (folder / f"{name}.g2o").write_text("VERTEX_SE2 0 1 0 0\nVERTEX_SE2 1 3 0 0\nEDGE_SE2 0 1 2 0 0 4 0 0 4 0 4\n")
    text = """(problem p (data n (g2o "g*.g2o" :vertices)) (data d (g2o "g?.g2o" :edges))
      (unknowns (a :init 0)) (observe n (= x a) :sigma 1) (observe d (= (information 2 2) a) :sigma 1))"""
    assert float(solved(folder, text)["a"].value) == pytest.approx((1 + 3 + 1 + 3 + 4 + 4) / 6, rel=EXACT)


def test_a_sandbox_holds_the_folder_and_the_files_that_fit(folder, tmp_path_factory, capsys):
    outside = tmp_path_factory.mktemp("outside")
    (outside / "A9.csv").write_text("x,y\n1,1\n")
    (folder / "A9.csv").symlink_to(outside / "A9.csv")
    (folder / "p.mbm").write_text(f'(problem p (data d (csv "A*.csv")) {LINE})')
    assert run(["solve", "p.mbm"]) == 0
    capsys.readouterr()
    assert run(["solve", "p.mbm", "--sandbox", "."]) == 2
    assert "outside-sandbox" in capsys.readouterr().err
    (folder / "p.mbm").write_text(f'(problem p (data d (csv "{outside.as_posix()}/Z*.csv")) {LINE})')
    assert run(["solve", "p.mbm", "--sandbox", "."]) == 2
    said = capsys.readouterr().err
    assert "outside-sandbox" in said and "no-match" not in said  # nothing tells what the folder holds


def test_the_number_of_files_is_bounded(folder):
    for i in range(MOST_MATCHES + 1):
        (folder / f"m{i}.csv").write_text("x,y\n1,1\n")
    (fault,) = raised(folder, f'(problem p (data d (csv "m*.csv")) {LINE})')
    assert fault.code.name == "too-many-matches"
    (folder / "m0.csv").unlink()
    assert solved(folder, f'(problem p (data d (csv "m*.csv")) {LINE})')["a"].value == pytest.approx(1, rel=EXACT)


def test_the_memory_of_all_files_is_bounded(folder, monkeypatch):
    for i in range(4):
        (folder / f"m{i}.csv").write_text("x,y\n" + "1,1\n" * 20_000)
    monkeypatch.setenv("MBM_MEMORY", "8MB")
    solved(folder, f'(problem p (data d (csv "m0.csv")) {LINE})')
    faults = raised(folder, f'(problem p (data d (csv "m*.csv")) {LINE})')
    assert [fault.code.name for fault in faults] == ["too-much-memory"]


def test_a_simulated_union_is_a_file_that_the_copy_reads(folder, capsys):
    (folder / "p.mbm").write_text(
        """(problem p (data e (csv "A2.csv") :columns ((y :unit mm))) (data f (csv "A10.csv") :columns ((y :unit cm)))
        (data d (union e f)) (unknowns (a :unit m)) (observe d (= y a) :sigma 1mm))
        (problem q (data d (csv "A*.csv")) (unknowns (a)) (observe d (= y a) :sigma 0.001))"""
    )
    (folder / "at.json").write_text('{"a": 0.5}')
    for name in "pq":
        assert run(["simulate", "p.mbm", "--problem", name, "--at", "at.json", "-o", f"out-{name}"]) == 0
        capsys.readouterr()
        assert run(["solve", f"out-{name}/p.mbm", "--problem", name, "--json", "-"]) == 0
        solve = json.loads(capsys.readouterr().out)["solves"][0]
        assert solve["estimates"]["a"]["value"] == pytest.approx(0.5, abs=5 * 0.001)  # five deviations of a row
        assert (solve["dof"], solve["residuals"]["d"]["rows"]) == (2, 3)
        assert (folder / f"out-{name}" / "d.csv").read_text().startswith(("x,y,source\n", "y,x,source\n"))


def test_a_generated_solver_reads_a_union_as_one_table(folder, capsys):
    (folder / "p.mbm").write_text(f'(problem p (data d (csv "A*.csv")) {LINE})')
    assert run(["compile", "p.mbm", "--target", "python", "-o", "solver"]) == 0
    header, *rows = (folder / "solver" / "data" / "d.csv").read_text().splitlines()
    assert [float(row.split(",")[header.split(",").index("y")]) for row in rows] == [30, 10, 20]


def test_the_same_answer_comes_from_the_cache(folder):
    text = f'(problem p (data d (csv "A*.csv")) {LINE})'
    first = float(solved(folder, text)["a"].value)
    (folder / "A3.csv").write_text("x,y\n1,100\n")
    assert (first, float(solved(folder, text)["a"].value)) == pytest.approx((20, 40), rel=EXACT)


def test_rows_on_one_line_of_the_problem_are_not_told_by_it(folder, capsys):
    rows = " ".join(f"(1 {y})" for y in (10, 10, 10, 99, 10))
    (folder / "p.mbm").write_text(f"(problem p (data d (table (x y) {rows})) {LINE} (solve :robust (lmeds)))")
    run(["solve", "p.mbm"])
    assert capsys.readouterr().out.rstrip().endswith("outliers: row 4")


def test_a_table_that_is_put_together_keeps_its_sources(folder):
    inline = "(data t (table (x y) (5 1)))"
    found = solved(
        folder, f'(problem p (data a (csv "A*.csv")) {inline} (data d (union t a)) (for-each source) {LINE})'
    )
    assert [solve.key["source"] for solve in found.solves] == ["A10", "A2", "t"]
    (fault,) = raised(
        folder, f'(problem p (data a (csv "A*.csv")) (data b (csv "A?.csv")) (data d (union a b)) {LINE})'
    )
    assert fault.code.name == "bad-pattern" and "both be told by the name `A2`" in fault.message
