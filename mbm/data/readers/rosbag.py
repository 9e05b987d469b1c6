"""Logs of ROS: ``(rosbag "f.bag" "/topic")`` (ROS 1) and ``(rosbag "f.mcap" "/topic")`` (ROS 1 and 2).

A row is a message; of transforms (``/tf``) each transform in it. Column ``t`` is the time in the header, ``logged``
that of the log, both in s; ``frame`` and ``child`` are the frames. Positions are ``x y z``, orientations
``qx qy qz qw``, velocities ``vx vy vz``, rates of turn ``wx wy wz``, accelerations ``ax ay az``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from mbm.data.columns import row_numbers
from mbm.data.content import check_table, most_unpacked, read_bytes
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import number_columns
from mbm.data.readers.rosbag_messages import KINDS, decoder, supported
from mbm.data.readers.rosbag_storage import DAMAGED, BagError, Topic, topics_of_bag, topics_of_mcap
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import Column
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, MbmError

MCAP = b"\x89MCAP0\r\n"
"""What an MCAP file begins with."""

SECONDS_PER_NANOSECOND = 1e-9
TIMES = ("t", "logged")


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """The tables of a log by their topics, each made when it is asked for.

    Raises:
        MbmError: as `read_bytes`, malformed-bag, missing-extra.

    """
    content, digest = read_bytes(path)
    place = DataPlace(file=path.as_posix())
    opened = topics_of_mcap if content.startswith(MCAP) else topics_of_bag
    try:
        kinds, messages = opened(content, most_unpacked(len(content)))
    except ImportError:
        raise MbmError(missing_extra("the format `rosbag`", "logs", place)) from None
    except BagError as error:
        raise MbmError(format_faults.malformed_bag(place, str(error))) from None

    def table(topic: str) -> RawTable:
        if topic not in kinds:
            raise MbmError(format_faults.no_topic(place, topic, tuple(kinds)))
        if kinds[topic] not in KINDS:
            raise MbmError(format_faults.other_messages(place, topic, kinds[topic], supported()))
        try:
            return _table(path, digest, topic, messages(topic))
        except BagError as error:
            raise MbmError(format_faults.malformed_bag(place, str(error))) from None

    return _Topics(kinds, table)


class _Topics(Mapping[str, "RawTable | MbmError"]):
    """The tables of a log; whatever it holds, any name may be asked for."""

    def __init__(self, kinds: Mapping[str, str], table: Callable[[str], RawTable]) -> None:
        self._kinds = kinds
        self._table = table

    def __getitem__(self, name: str) -> RawTable | MbmError:
        try:
            return self._table(name)
        except MbmError as error:
            return error

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str)

    def __iter__(self) -> Iterator[str]:
        return iter(topic for topic, kind in self._kinds.items() if kind in KINDS)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _table(path: Path, digest: str, topic: str, found: Topic) -> RawTable:
    kind = KINDS[found.kind]
    place = DataPlace(file=path.as_posix())
    names = (*TIMES, *kind.numbers)
    check_table(path, len(found.messages) * (len(names) + len(kind.texts)))
    numbers: list[tuple[float, ...]] = []
    texts: list[tuple[str, ...]] = []
    message = 0
    try:
        decode = decoder(found.encoding, found.kind, found.digest)
        for message, (logged, data) in enumerate(found.messages, 1):  # noqa: B007 - said of what fails
            for header, cells, words in kind.rows(decode(data)):
                stamp = header.stamp.sec + header.stamp.nanosec * SECONDS_PER_NANOSECOND
                numbers.append((stamp, logged * SECONDS_PER_NANOSECOND, *map(float, cells)))
                texts.append(tuple(map(str, words)))
    except DAMAGED as error:
        reason = f"message {message} of `{topic[:40]}` cannot be read: {str(error)[:80] or type(error).__name__}"
        raise MbmError(format_faults.malformed_bag(place, reason)) from None
    if not numbers:
        raise MbmError(format_faults.no_records(place, f"messages of `{topic[:40]}`"))
    columns = [*number_columns(names, np.array(numbers))]
    columns += [Column(name=name, texts=tuple(row[i] for row in texts)) for i, name in enumerate(kind.texts)]
    return RawTable(path=path.as_posix(), sha256=digest, columns=tuple(columns), file_rows=row_numbers(1, len(numbers)))


READER = ManyReader(name="rosbag", extensions=(".bag", ".mcap"), parts=(), read=read, named=True)
