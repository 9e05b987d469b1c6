"""Whatever stands in a problem file or its data, the answer is a result or diagnostics: never anything else.

Some 1,500 cases; other ones in every commit, and the same in every run of one. ``make fuzz`` tries a million.
"""

from __future__ import annotations

import os

import pytest

from tests.fuzz.kinds import KINDS, home
from tests.trials.blocks import Block, blocks_of, run_block
from tests.trials.kinds import Home
from tests.trials.outcome import known_codes
from tests.trials.seeds import VARIABLE, base_seed

CASES = int(os.environ.get("MBM_FUZZ_CASES", "1500"))
BLOCKS = blocks_of(KINDS, CASES, base_seed())


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Home:
    return home(tmp_path_factory.mktemp("fuzz"))


def test_the_codes_were_found() -> None:
    assert {"unclosed-bracket", "unknown-name", "bad-cell", "not-available-yet"} <= known_codes()


def test_the_kinds_are_all_there_is() -> None:
    assert sum(kind.share for kind in KINDS) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: f"{b.kind.name.replace(' ', '-')}-{b.number}")
def test_an_answer_is_a_result_or_diagnostics(block: Block, place: Home, request: pytest.FixtureRequest) -> None:
    found = run_block(block, place)
    again = f'{VARIABLE}={block.base} pytest "tests/fuzz/test_fuzz.py::{request.node.name}"'
    if found.fault is not None:
        pytest.fail(f"{found.fault}\nthe same once more: {again}", pytrace=False)
    assert found.ran == block.count
