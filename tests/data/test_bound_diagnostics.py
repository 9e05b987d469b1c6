"""What is bounded where bytes come in: sizes that are announced, sizes that come out, names, files. Each bound is
tried from both sides, with the limit in the message and the way to raise it."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

import mbm.data.readers.parquet
from mbm.cli.main import run
from mbm.data.cells import MOST_COLUMNS
from mbm.data.loader import MOST_FILES

PROBLEM = "(problem p (data d {source}) (unknowns (a :init 1)) (observe d (= x a) :sigma 1))\n"


@pytest.fixture
def checked(tmp_path, capfd, monkeypatch):
    """Checks a problem that reads ``source``: the exit status and what is said on standard error."""
    monkeypatch.chdir(tmp_path)

    def check(source):
        Path("p.mbm").write_text(PROBLEM.format(source=source))
        return run(["check", "p.mbm"]), capfd.readouterr().err

    return check


def archive(path, shape, content, *, compression=zipfile.ZIP_DEFLATED):
    """An npz file of one column ``x`` that announces ``shape`` and holds ``content``."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w", compression) as packed:
        packed.writestr("x.npy", header.getvalue() + content)


def test_an_archive_that_unpacks_to_a_thousand_times_its_size(checked, tmp_path):
    archive(tmp_path / "d.npz", (20_000_000,), bytes(160_000_000))
    assert (tmp_path / "d.npz").stat().st_size < 200_000
    status, said = checked('(npz "d.npz")')
    assert (status, "error[file-too-large]" in said) == (2, True), said
    archive(tmp_path / "d.npz", (1_000_000,), bytes(8_000_000))
    assert checked('(npz "d.npz")')[0] == 0


def test_numbers_that_are_packed_small_count_as_the_table_has_them(checked, tmp_path):
    """A byte for each in the file, eight in the table: columns of a few kilobytes take more than the archive says."""
    np.savez_compressed(tmp_path / "d.npz", x=np.zeros(5_000_000, dtype=np.int8))
    status, said = checked('(npz "d.npz")')
    assert (status, "error[file-too-large]" in said) == (2, True), said
    np.savez(tmp_path / "d.npz", x=np.zeros(5_000_000, dtype=np.int8))
    assert checked('(npz "d.npz")')[0] == 0


def test_an_archive_that_announces_more_than_it_holds(checked, tmp_path):
    archive(tmp_path / "d.npz", (10**12,), bytes(800))
    status, said = checked('(npz "d.npz")')
    assert status == 2
    assert "internal" not in said


def test_a_parquet_file_of_many_rows_in_few_bytes(checked, tmp_path):
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    table = arrow.table({"x": arrow.array(np.zeros(10_000_000))})
    with parquet.ParquetWriter(tmp_path / "d.parquet", table.schema, compression="zstd") as writer:
        for _ in range(30):
            writer.write_table(table)
    status, said = checked('(parquet "d.parquet")')
    assert status == 2
    assert "error[too-much-memory]" in said or "error[file-too-large]" in said, said
    assert "MBM_MEMORY" in said
    parquet.write_table(table.slice(0, 100_000), tmp_path / "d.parquet")
    assert checked('(parquet "d.parquet")')[0] == 0


def test_records_that_have_no_name_in_common(checked, tmp_path):
    """30,000 records of one name each would be a table of 9·10⁸ cells."""
    (tmp_path / "d.json").write_text(json.dumps([{f"n{i}": 1.0} for i in range(30_000)]))
    status, said = checked('(json "d.json")')
    assert (status, "error[too-much-memory]" in said) == (2, True), said
    assert "MBM_MEMORY" in said


def test_a_name_that_occurs_twice_among_many(checked, tmp_path):
    names = ", ".join(f'"n{i}": [1]' for i in range(30_000))
    (tmp_path / "d.json").write_text(f'{{{names}, "n29999": [1]}}')
    status, said = checked('(json "d.json")')
    assert (status, "error[duplicate-column]" in said) == (2, True), said
    assert "`n29999`" in said


@pytest.mark.parametrize("beyond", [0, 1])
def test_columns(checked, tmp_path, beyond):
    names = ["x", *(f"c{i}" for i in range(MOST_COLUMNS - 1 + beyond))]
    (tmp_path / "d.csv").write_text(",".join(names) + "\n" + ",".join(["1"] * len(names)) + "\n")
    status, said = checked('(csv "d.csv")')
    assert status == (2 if beyond else 0), said
    assert ("too-many-columns" in said) == bool(beyond)
    assert not beyond or f"{MOST_COLUMNS:,}" in said


@pytest.mark.parametrize("beyond", [0, 1])
def test_files(tmp_path, capfd, beyond):
    (tmp_path / "d.csv").write_text("x\n1\n")
    clauses = " ".join(f'(data d{i} (csv "d.csv"))' for i in range(MOST_FILES + beyond))
    (tmp_path / "p.mbm").write_text(f"(problem p {clauses} (unknowns (a :init 1)) (observe d0 (= x a) :sigma 1))")
    status = run(["check", str(tmp_path / "p.mbm")])
    said = capfd.readouterr().err
    assert status == (2 if beyond else 0), said[:1000]
    assert ("error[too-many-files]" in said) == bool(beyond)


def test_the_memory_bound_can_be_set(checked, tmp_path, monkeypatch):
    (tmp_path / "d.csv").write_text("x\n" + "1.5\n" * 100_000)
    assert checked('(csv "d.csv")')[0] == 0
    monkeypatch.setenv("MBM_MEMORY", "2MB")
    status, said = checked('(csv "d.csv")')
    assert (status, "error[too-much-memory]" in said) == (2, True), said
    monkeypatch.setenv("MBM_MEMORY", "1e9 bytes")
    status, said = checked('(csv "d.csv")')
    assert (status, "error[bad-memory-bound]" in said) == (2, True), said
    assert "MBM_MEMORY=4GB" in said


SUM, CHOICES = "(sum (i 1 7500) (* a i))", "(sum (i 1 {}) (if (< a i) (* a i) 1))"


@pytest.mark.parametrize(
    ("terms", "refused"),
    [
        ([SUM], False),  # 15,000 operations, and twenty for the equation
        ([SUM, SUM], True),
        ([CHOICES.format(1900)], False),  # as many: a condition and a choice count for three each
        ([CHOICES.format(3000)], True),  # 12,000 operations, of which 6,000 count for three
        (["a"] * 740, False),
        (["a"] * 751, True),
        ([f"(* {'a ' * 16})"] * 740, True),  # 11,100 operations in 740 equations
    ],
    ids=["a-sum", "two-sums", "1900-choices", "3000-choices", "740-equations", "751-equations", "both"],
)
def test_what_is_written_out_is_bounded(terms, refused, tmp_path, capfd):
    equations = " ".join(f"(observe (= 1 {term}) :sigma 1)" for term in terms)
    (tmp_path / "p.mbm").write_text(f"(problem p (unknowns (a :init 1)) {equations})")
    assert run(["check", str(tmp_path / "p.mbm")]) == (2 if refused else 0)
    assert ("error[too-much-to-compile]" in capfd.readouterr().err) == refused


def test_more_may_be_written_out_where_somebody_says_so(tmp_path, capfd, monkeypatch):
    (tmp_path / "p.mbm").write_text(f"(problem p (unknowns (a :init 1)) (observe (= 1 (+ {SUM} {SUM})) :sigma 1))")
    said = {}
    for stated in ("", "1", "1.2", "2.5", "1e3", "many", "0", "-1", "inf"):
        monkeypatch.setenv("MBM_WORK", stated)
        assert run(["check", str(tmp_path / "p.mbm")]) == (0 if stated in ("2.5", "1e3") else 2)
        said[stated] = capfd.readouterr().err
    assert "more than 16,000 operations" in said["1"]
    assert "MBM_WORK=4" in said[""]
    assert "MBM_WORK=4.8" in said["1.2"]
    for stated in ("many", "0", "-1", "inf"):
        wrong = f"error[bad-work-bound]: `MBM_WORK` is `{stated}`, which is no number from 0.01 to 1,000,000"
        assert wrong in said[stated]


def test_a_column_of_nothing_is_looked_at_once(checked, tmp_path, monkeypatch):
    """It is neither numbers nor texts; looked at again with every sixteen rows, 300,000 of them took half a minute."""
    arrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow.table({"x": arrow.nulls(100_000)}), tmp_path / "d.parquet")
    seen = []
    real = mbm.data.readers.parquet.column_from_values
    monkeypatch.setattr(
        mbm.data.readers.parquet, "column_from_values", lambda *given: seen.append(given[0]) or real(*given)
    )
    status, said = checked('(parquet "d.parquet")')
    assert "internal" not in said
    assert seen == ["x"], status
