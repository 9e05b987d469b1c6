"""Files and command lines that mean harm, or are careless: an answer comes, bounded, and nothing else happens.

Some hundred cases in the default run, other ones in every commit; ``make hostile`` tries 100,000. What happens besides
the answer is heard of from Python itself (`tests.trials.watching`).
"""

from __future__ import annotations

import os

import pytest

from tests.hostile.kinds import KINDS, home
from tests.trials.blocks import Block, blocks_of, run_block
from tests.trials.kinds import Home
from tests.trials.seeds import VARIABLE, base_seed

CASES = int(os.environ.get("MBM_HOSTILE_CASES", "400"))
BLOCKS = blocks_of(KINDS, CASES, base_seed())


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Home:
    return home(tmp_path_factory.mktemp("hostile"))


def test_the_kinds_are_all_there_is() -> None:
    assert sum(kind.share for kind in KINDS) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: f"{b.kind.name.replace(' ', '-')}-{b.number}")
def test_nothing_but_an_answer(block: Block, place: Home, request: pytest.FixtureRequest) -> None:
    found = run_block(block, place)
    again = f'{VARIABLE}={block.base} pytest "tests/hostile/test_hostile.py::{request.node.name}"'
    if found.fault is not None:
        pytest.fail(f"{found.fault}\nthe same once more: {again}", pytrace=False)
    assert found.ran == block.count
