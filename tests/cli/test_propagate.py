"""``mbm propagate``: its table, its document and its files of samples."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

TEXT = """
(problem area
  (constants (a 10mm :sigma 0.1mm) (b 20mm :prior (rectangular 19mm 21mm)))
  (derive (q (* a b) :unit mm^2) (s [a b] :unit mm)))
"""
KEYED = """
(problem keyed
  (data d (table (k y) ("one" 1.0) ("two" 5.0)))
  (unknowns (m))
  (observe d (= y m) :sigma 0.1)
  (for-each k))
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("area.mbm").write_text(TEXT, encoding="utf-8")
    Path("keyed.mbm").write_text(KEYED, encoding="utf-8")


def test_the_table_has_a_line_for_each_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["propagate", "area.mbm", "--trials", "20000", "--seed", "3"]) == 0
    shown = capsys.readouterr()
    lines = shown.out.splitlines()
    assert lines[0] == "area.mbm: problem `area`"
    assert lines[2] == "20,000 trials, 95 % intervals"
    assert [line.split()[0] for line in lines[5:]] == ["q", "s[1]", "s[2]"]
    assert lines[5].startswith("  q     200.0 mm^2  6.1")
    assert lines[6].endswith("agrees")  # normal
    assert lines[7].endswith("differs")  # rectangular
    assert shown.err == ""


def test_the_document_is_that_of_the_solve_with_what_the_trials_say(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["propagate", "area.mbm", "--trials", "2e4", "--json", "-", "--set", "a=11mm"]) == 0
    solve = json.loads(capsys.readouterr().out)["solves"][0]
    assert solve["derived"]["q"]["value"] == pytest.approx(220.0)
    found = solve["propagation"]
    assert (found["trials"], found["failed"], found["coverage"]) == (20_000, 0, 0.95)
    assert set(found["q"]) == {"mean", "sigma", "interval", "shortest", "median", "validated", "unit"}
    assert found["q"]["mean"] == pytest.approx(220.0, abs=0.3)
    assert found["q"]["unit"] == "mm^2"
    assert np.shape(found["s"]["interval"]) == (2, 2)
    assert found["s"]["sigma"] == pytest.approx([0.1, 1 / np.sqrt(3.0)], rel=0.02)


def test_the_same_call_writes_the_same_bytes_whatever_the_threads() -> None:
    written = []
    for workers in ("1", "2"):
        assert run(["propagate", "keyed.mbm", "--trials", "11000", "--json", "a.json", "--workers", workers]) == 0
        text = Path("a.json").read_text(encoding="utf-8")
        written.append([line for line in text.splitlines() if '"seconds"' not in line])
    assert written[0] == written[1]


def test_samples_are_written_for_numpy() -> None:
    assert run(["propagate", "area.mbm", "--trials", "500", "--samples", "s.npz"]) == 0
    with np.load("s.npz") as found:
        assert sorted(found) == ["q", "s[1]", "s[2]"]
        np.testing.assert_allclose(found["q"], found["s[1]"] * found["s[2]"])
        assert found["q"].shape == (500,)


def test_samples_may_have_any_name(tmp_path: Path) -> None:
    text = """(problem p (data d (table (day y) ("mon" 1) ("mon" 2) ("tue" 3) ("tue" 5))) (for-each day)
      (unknowns (m) (file)) (constraints (normal file 0 1)) (observe d (= y m) :sigma 1) (derive (day m)))"""
    made = mbm.loads(text).propagate(50)
    made.save(tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as found:
        assert sorted(found) == ["day", "file", "key.day", "m"]
        assert found["key.day"].tolist() == ["mon"] * 50 + ["tue"] * 50
        assert found["day"][50:].mean() == pytest.approx(4.0, abs=5 * np.sqrt(0.5 / 50))


def test_samples_are_written_as_parquet_with_the_keys() -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    assert run(["propagate", "keyed.mbm", "--trials", "100", "--samples", "s.parquet"]) == 0
    found = parquet.read_table("s.parquet").to_pydict()
    assert sorted(found) == ["k", "m"]
    assert found["k"] == ["one"] * 100 + ["two"] * 100


@pytest.mark.filterwarnings("ignore")  # arviz announces its next version
def test_samples_are_written_for_arviz() -> None:
    arviz = pytest.importorskip("arviz")
    made = mbm.load("area.mbm").propagate(200)
    made.save("s.nc")
    found = arviz.from_netcdf("s.nc").posterior
    assert found["s"].shape == (1, 200, 2)
    np.testing.assert_array_equal(found["q"].values[0], made["q"].samples)
    np.testing.assert_array_equal(made.to_arviz().posterior["q"].values[0], made["q"].samples)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--trials", "some"], "bad-call"),
        (["--trials", "1"], "bad-call"),
        (["--trials", "1.5"], "bad-call"),
        (["--trials", "1e11"], "too-many-trials"),
        (["--samples", "s.txt"], "sample-format"),
        (["--samples", "area.mbm.npz", "--json", "area.mbm.npz"], "would-overwrite"),
        (["--json", "area.mbm"], "would-overwrite"),
    ],
)
def test_calls_that_are_wrong_make_no_trial(options: list[str], code: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["propagate", "area.mbm", *options]) == 2
    assert code in capsys.readouterr().err
    assert Path("area.mbm").read_text(encoding="utf-8") == TEXT
    assert not Path("s.txt").exists()


def test_several_solves_are_no_inference_data(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("arviz")
    assert run(["propagate", "keyed.mbm", "--trials", "100", "--samples", "s.nc"]) == 2
    assert "sample-format" in capsys.readouterr().err
    assert not Path("s.nc").exists()


def test_a_quantity_may_be_called_as_a_number_of_the_trials() -> None:
    found = mbm.loads("(problem p (constants (a 1 :sigma 1)) (derive (trials (* 2 a))))").propagate(100)
    written = found.document()["solves"][0]["propagation"]
    assert written["trials"] == 100
    assert set(written["trials (quantity)"]) >= {"mean", "sigma"}
