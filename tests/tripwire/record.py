"""The record as a file in a folder: a compressed archive of columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.tripwire.answers import Answer

FILE = "record.npz"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What one path answered to a case whose text has the ``digest``."""

    digest: int
    answers: tuple[Answer, ...]


Record = Mapping[tuple[str, str], Entry]
"""By the name of the case and the path."""


def _text(lines: Iterable[str]) -> np.ndarray:
    return np.frombuffer("\n".join(lines).encode(), dtype=np.uint8)


def _lines(array: np.ndarray) -> list[str]:
    return array.tobytes().decode().split("\n") if len(array) else []


def write(record: Record, folder: Path) -> None:
    """The record, to be read by `read`; makes the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    solves = [answer for entry in record.values() for answer in entry.answers]
    statuses = sorted({answer.status for answer in solves})
    np.savez_compressed(
        folder / FILE,
        keys=_text(f"{case}|{path}" for case, path in record),
        digests=np.array([entry.digest for entry in record.values()], dtype=np.int64),
        solves=np.array([len(entry.answers) for entry in record.values()], dtype=np.int16),
        statuses=_text(statuses),
        status=np.array([statuses.index(answer.status) for answer in solves], dtype=np.int16),
        counts=np.array([len(answer.values) for answer in solves], dtype=np.int32),
        cost=np.array([answer.cost for answer in solves]),
        dof=np.array([answer.dof for answer in solves], dtype=np.int32),
        values=np.concatenate([np.zeros(0), *(answer.values for answer in solves)]),
        sigmas=np.concatenate([np.zeros(0), *(answer.sigmas for answer in solves)]).astype(np.float32),
    )


def read(folder: Path) -> Record:
    """What was recorded."""
    with np.load(folder / FILE) as archive:
        columns = {name: archive[name] for name in archive.files}
    statuses, ends = _lines(columns["statuses"]), np.cumsum(columns["counts"])
    answers = [
        Answer(
            status=statuses[status],
            values=columns["values"][end - count : end],
            sigmas=columns["sigmas"][end - count : end].astype(float),
            cost=float(cost),
            dof=int(dof),
        )
        for status, end, count, cost, dof in zip(
            columns["status"], ends, columns["counts"], columns["cost"], columns["dof"], strict=True
        )
    ]
    last = np.cumsum(columns["solves"])
    return {
        tuple(key.rsplit("|", 1)): Entry(digest=int(digest), answers=tuple(answers[end - count : end]))
        for key, digest, end, count in zip(
            _lines(columns["keys"]), columns["digests"], last, columns["solves"], strict=True
        )
    }
