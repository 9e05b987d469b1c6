"""Whole processes, from their start to their exit status: a few in the default run; ``make processes`` tries 1,000."""

from __future__ import annotations

import os
import sys

import pytest

from tests.hostile.processes import KINDS, home
from tests.trials.blocks import Block, blocks_of, run_block
from tests.trials.kinds import Home
from tests.trials.processes import outcome_of_process
from tests.trials.seeds import VARIABLE, base_seed

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes and devices of POSIX systems")

CASES = int(os.environ.get("MBM_HOSTILE_PROCESSES", "8"))
BLOCKS = blocks_of(KINDS, CASES, base_seed())


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Home:
    return home(tmp_path_factory.mktemp("processes"))


def test_the_kinds_are_all_there_is() -> None:
    assert sum(kind.share for kind in KINDS) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: f"{b.kind.name.replace(' ', '-')}-{b.number}")
def test_a_process_ends_with_an_answer(block: Block, place: Home, request: pytest.FixtureRequest) -> None:
    found = run_block(block, place)
    again = f'{VARIABLE}={block.base} pytest "tests/hostile/test_processes.py::{request.node.name}"'
    if found.fault is not None:
        pytest.fail(f"{found.fault}\nthe same once more: {again}", pytrace=False)
    assert found.ran == block.count


def test_what_a_process_touches_is_heard_of(place: Home) -> None:
    """The results go where nothing may be written; the problem is closed to it."""
    folder, elsewhere = place.cleared("case"), place.folder.parent / "elsewhere.csv"
    file = folder / "p.mbm"
    file.write_text("(problem p (unknowns (a :init 1)) (observe (= 1 a) :sigma 1))", encoding="utf-8")
    asked = ("solve", "p.mbm", "--backend", "numpy", "--csv", str(elsewhere))
    found, heard = outcome_of_process(*asked, folder=folder, devices=(), closed=(file,))
    assert (found.status, found.err) == (0, "")
    assert "a 1.0" in " ".join(found.out.split())
    assert f"read: {file.name}" in heard
    assert any(line.startswith(("written: ", "os.rename: ")) and "elsewhere" in line for line in heard)
    assert 10**7 < found.grown < 10**9
    assert 0 < found.seconds < 60


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere what the process held that started it is counted")
def test_memory_is_that_of_the_process_alone(place: Home) -> None:
    held = bytearray(10**9)
    held[:: 1 << 12] = b"x" * len(held[:: 1 << 12])  # so that all of it is resident
    found, _ = outcome_of_process("check", "missing.mbm", folder=place.cleared("case"), devices=(), closed=())
    assert 10**7 < found.grown < len(held) // 2


def test_the_status_is_that_of_the_process(place: Home) -> None:
    folder = place.cleared("case")
    found, heard = outcome_of_process("check", "missing.mbm", folder=folder, devices=(), closed=())
    assert (found.status, found.out, heard) == (2, "", [])
    assert "error[missing-file]" in found.err
