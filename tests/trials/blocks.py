"""Some hundred cases of one kind, from one seed; found faults are made small by Hypothesis, but for slow cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings, strategies as st
from hypothesis.errors import HypothesisException

from tests.trials.kinds import Home, Kind, Trial, attempt
from tests.trials.seeds import seed_for

LARGEST = 1000
"""Cases of a block: once one of them fails, the others are not tried, but for those that are merely slow."""


class FaultError(Exception):
    """A case whose answer is not as it should be."""

    def __init__(self, trial: Trial) -> None:
        super().__init__(str(trial))
        self.trial = trial


@dataclass(frozen=True, kw_only=True)
class Block:
    """The ``count`` cases number ``number`` of a kind in a run with the seed ``base``."""

    kind: Kind
    number: int
    count: int
    base: int

    @property
    def seed(self) -> int:
        """The seed of this block."""
        return seed_for(self.base, self.kind.name, self.number)


@dataclass(frozen=True, kw_only=True)
class Result:
    """How many cases of a block were tried, and the smallest one that failed, with the words of its fault."""

    ran: int
    fault: str | None = None
    decisions: bytes | None = None


def blocks_of(kinds: Sequence[Kind], cases: int, base: int) -> tuple[Block, ...]:
    """So many cases, shared out among the kinds, each in blocks of at most `LARGEST`."""
    found = []
    for kind in kinds:
        left, number = max(round(cases * kind.share), 1), 0
        while left > 0:
            found.append(Block(kind=kind, number=number, count=min(left, LARGEST), base=base))
            left, number = left - LARGEST, number + 1
    return tuple(found)


def run_block(block: Block, home: Home, notice: Callable[[bytes], None] | None = None) -> Result:
    """Tries the cases; ``notice`` hears of each before it is run."""
    return _drawn(block, home, notice) if home.processes else _searched(block, home, notice)


def _drawn(block: Block, home: Home, notice: Callable[[bytes], None] | None) -> Result:
    """Cases as they come, none made small: a process takes a second, and blocks of few cases hold no simplest one."""
    draw = np.random.default_rng(block.seed)
    for ran in range(1, block.count + 1):
        decisions = draw.bytes(block.kind.size)
        if notice is not None:
            notice(decisions)
        trial = attempt(block.kind, home, decisions)
        if trial.wrong:
            return Result(ran=ran, fault=str(trial), decisions=decisions)
    return Result(ran=block.count)


def _searched(block: Block, home: Home, notice: Callable[[bytes], None] | None) -> Result:
    ran, last, words = 0, b"", ""
    slow: list[tuple[bytes, str]] = []

    @seed(block.seed)
    @settings(
        max_examples=block.count,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
        report_multiple_bugs=False,
    )
    @given(decisions=st.binary(min_size=block.kind.size, max_size=block.kind.size))
    def search(decisions: bytes) -> None:
        nonlocal ran, last, words
        ran += 1
        if notice is not None:
            notice(decisions)
        trial = attempt(block.kind, home, decisions)
        if trial.wrong and trial.slow:
            slow.append((decisions, str(trial)))  # now: the next case writes over the files of this one
        elif trial.wrong:
            last, words = decisions, str(trial)
            raise FaultError(trial)

    faults = []
    try:
        search()
    except FaultError as error:
        faults = [str(error)]
    except HypothesisException:  # a case that failed once, and not again
        faults = [f"not always: {words}"]
    if slow:
        last = last if faults else slow[0][0]
        faults += ["slow: " + ", ".join(text.partition("\n")[0] for _, text in slow), *(text for _, text in slow)]
    return Result(ran=min(ran, block.count), fault="\n\n".join(faults) or None, decisions=last or None)
