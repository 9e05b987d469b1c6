"""Very many cases in parts, each part a process of its own: ``python -m tests.trials.campaign --parts 1-20``.

What a part found is one line of the record; parts that stand there for the same sources, seed and number of cases are
not run again. Faults are left in a folder each, with the files and the command line that show them.
"""

from __future__ import annotations

import argparse
import gc
import json
import multiprocessing
import os
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any

from mbm.cli.main import COLLECTED
from mbm.kernels.store import VARIABLE
from tests.trials.seeds import base_seed, digest_of_sources, seed_for

SILENCE = 300.0
"""Seconds that one case may take before its part is ended: it hangs where no exception reaches."""
LAST = "last-case"
"""The file that holds what decides the case that is being tried."""
MEMORY = 4 << 30
"""Bytes of address space that a part may take; the libraries that are loaded are a quarter of that."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Which cases are tried: ``cases`` in ``of`` parts, of the kinds that the module ``kinds`` holds."""

    kinds: str
    cases: int
    of: int
    seed: int
    sources: str

    def key(self, part: int) -> dict[str, Any]:
        """What tells a part from all others in the record."""
        return {**vars(self), "part": part}


@dataclass(kw_only=True)
class Running:
    """A part that is being tried."""

    part: int
    process: SpawnProcess
    inbox: Connection
    folder: Path

    @property
    def hangs(self) -> bool:
        """Its last case was begun long ago."""
        try:
            return time.time() - (self.folder / LAST).stat().st_mtime > SILENCE
        except FileNotFoundError:
            return False


def run_part(plan: Plan, part: int, folder: str, outbox: Connection) -> None:
    """Tries all cases of a part; every block is reported when it is done, the last message is None."""
    from tests.trials.blocks import blocks_of, run_block

    os.nice(5)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    os.environ[VARIABLE] = str(Path(folder) / "cache")
    said = os.open(Path(folder) / "aside", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for output in (1, 2):
        os.dup2(said, output)
    gc.set_threshold(COLLECTED, *gc.get_threshold()[1:])
    kinds = import_module(plan.kinds)
    home = kinds.home(Path(folder))
    last = Path(folder) / LAST

    def notice(decisions: bytes) -> None:
        last.write_bytes(decisions)

    for block in blocks_of(kinds.KINDS, plan.cases // plan.of, seed_for(plan.seed, part)):
        begin = _worked()
        last.with_suffix(".kind").write_text(block.kind.name, encoding="utf-8")
        result = run_block(block, home, notice)
        outbox.send(
            {
                "kind": block.kind.name,
                "ran": result.ran,
                "fault": result.fault,
                "decisions": None if result.decisions is None else result.decisions.hex(),
                "seconds": _worked() - begin,
            }
        )
    outbox.send(None)


def _worked() -> float:
    """Seconds of processor time of this process and of those that it waited for."""
    return sum(os.times()[:4])


def started(plan: Plan, part: int) -> Running:
    """The part in a process of its own."""
    context = multiprocessing.get_context("spawn")
    inbox, outbox = context.Pipe(duplex=False)
    folder = Path(tempfile.mkdtemp(prefix="mbm-trials-"))
    process = context.Process(target=run_part, args=(plan, part, str(folder), outbox), daemon=True)
    process.start()
    outbox.close()
    return Running(part=part, process=process, inbox=inbox, folder=folder)


class Record:
    """What was tried: one line of JSON for each part, and a folder for each fault."""

    def __init__(self, folder: Path, plan: Plan) -> None:
        self._file = folder / "record.jsonl"
        self._faults = folder / "faults"
        self._plan = plan
        folder.mkdir(parents=True, exist_ok=True)

    def done(self) -> dict[int, dict[str, Any]]:
        """The parts of the plan that were run to their end."""
        lines = self._file.read_text(encoding="utf-8").splitlines() if self._file.exists() else []
        entries = [json.loads(line) for line in lines]
        return {e["part"]: e for e in entries if self._plan.key(e["part"]).items() <= e.items()}

    def add(self, part: int, blocks: Sequence[dict[str, Any]]) -> None:
        """A part that has come to its end."""
        ran: Counter[str] = Counter()
        seconds: Counter[str] = Counter()
        for block in blocks:
            ran[block["kind"]] += block["ran"]
            seconds[block["kind"]] += block["seconds"]
        entry = {
            **self._plan.key(part),
            "ran": ran,
            "seconds": {kind: round(value, 1) for kind, value in seconds.items()},
            "faults": [block["fault"].splitlines()[0] for block in blocks if block["fault"]],
        }
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(entry) + "\n")

    def keep_fault(self, part: int, block: dict[str, Any]) -> Path:
        """Writes down a fault; the text holds the files and the command line."""
        self._faults.mkdir(exist_ok=True)
        path = self._faults / f"{block['kind'].replace(' ', '-')}-{part}-{len(list(self._faults.iterdir()))}.txt"
        path.write_text(f"{block['fault']}\n--- decisions\n{block['decisions']}\n", encoding="utf-8")
        return path


def run(plan: Plan, parts: Sequence[int], processes: int, record: Record) -> None:
    """Runs the parts that are not in the record, some at a time."""
    waiting = [part for part in parts if part not in record.done()]
    running: dict[int, Running] = {}
    blocks: dict[int, list[dict[str, Any]]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                part = waiting.pop(0)
                running[part], blocks[part] = started(plan, part), []
            for one in _heard(running):
                message = _message(one)
                if message is None:
                    record.add(one.part, blocks[one.part])
                    _leave(running.pop(one.part))
                    _say(f"part {one.part} of {plan.of}: done")
                else:
                    blocks[one.part].append(message)
                    if message["fault"]:
                        path = record.keep_fault(one.part, message)
                        _say(f"part {one.part}: {message['kind']}: {message['fault'].splitlines()[0]} ({path})")
    finally:
        for one in running.values():
            _leave(one)


def _heard(running: dict[int, Running]) -> list[Running]:
    """Parts with something to say, and parts that hang."""
    by_inbox = {one.inbox: one for one in running.values()}
    ready = [by_inbox[inbox] for inbox in wait(list(by_inbox), timeout=1.0) if isinstance(inbox, Connection)]
    return ready + [one for one in running.values() if one not in ready and one.hangs]


def _message(one: Running) -> dict[str, Any] | None:
    """What a part says; where it has died or hangs, the case at which it did, and None at the next call."""
    last = one.folder / LAST
    words = "no end, and no exception ends it"
    try:
        if one.inbox.poll():
            found: dict[str, Any] | None = one.inbox.recv()
            return found
        one.process.kill()
    except EOFError:
        one.process.join()
        words = f"the process ended with {one.process.exitcode}"
    if not last.exists():
        return None
    decisions, kind = last.read_bytes().hex(), last.with_suffix(".kind").read_text(encoding="utf-8")
    last.unlink()
    return {"kind": kind, "ran": 0, "fault": words, "decisions": decisions, "seconds": 0.0}


def _leave(one: Running) -> None:
    one.process.kill()
    one.process.join()
    one.inbox.close()
    shutil.rmtree(one.folder, ignore_errors=True)


def _say(words: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {words}", flush=True)


def summary(plan: Plan, record: Record) -> tuple[str, int]:
    """What the record holds of the plan, and how many faults."""
    done = record.done()
    ran: Counter[str] = Counter()
    seconds: Counter[str] = Counter()
    for entry in done.values():
        ran.update(entry["ran"])
        seconds.update(entry["seconds"])
    faults = [fault for entry in done.values() for fault in entry["faults"]]
    lines = [f"{ran[kind]:>10,} {kind}, {1000 * seconds[kind] / ran[kind]:.1f} ms each" for kind in ran]
    lines.append(f"{sum(ran.values()):>10,} cases in {len(done)} of {plan.of} parts, seed {plan.seed}, "
                 f"{sum(seconds.values()) / 60:.0f} min of work, {len(faults)} faults")  # fmt: skip
    return "\n".join(lines), len(faults)


def numbers(text: str) -> list[int]:
    """``1-3,7`` → [1, 2, 3, 7]."""
    found = []
    for piece in text.split(","):
        first, _, last = piece.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def main() -> int:
    """The command line; 1 where there are faults."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", default="tests.fuzz.kinds", help="the module with KINDS and home")
    parser.add_argument("--cases", type=int, default=1_000_000, help="of all parts together")
    parser.add_argument("--of", type=int, default=20, help="number of parts")
    parser.add_argument("--parts", default="", help="those to run now: 1-20")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=base_seed())
    parser.add_argument("--record", type=Path, default=Path(".fuzz"), help="the folder of the record")
    given = parser.parse_args()
    plan = Plan(kinds=given.kinds, cases=given.cases, of=given.of, seed=given.seed, sources=digest_of_sources())
    record = Record(given.record, plan)
    _say(f"seed {plan.seed}; record in {given.record}")
    run(plan, numbers(given.parts or f"1-{plan.of}"), given.processes, record)
    text, faults = summary(plan, record)
    print(text)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
