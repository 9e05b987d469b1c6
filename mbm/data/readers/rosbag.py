"""Logs of ROS: ``(rosbag "f.bag" "/topic")`` (ROS 1) and ``(rosbag "f.mcap" "/topic")`` (ROS 1 and 2). Messages of ROS
→ columns of numbers: which fields of which types, by the names that other formats have for them.

A row is a message; of transforms (``/tf``) each transform in it. Column ``t`` is the time in the header, ``logged``
that of the log, both in s; ``frame`` and ``child`` are the frames. Positions are ``x y z``, orientations
``qx qy qz qw``, velocities ``vx vy vz``, rates of turn ``wx wy wz``, accelerations ``ax ay az``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from mbm.data.cells import row_numbers
from mbm.data.content import check_table, most_unpacked, read_bytes
from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import number_columns
from mbm.data.readers.rosbag_storage import DAMAGED, BagError, Topic, topics_of_bag, topics_of_mcap
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import POSITION, Column
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

Cells: TypeAlias = tuple[float | str, ...]

TURN = ("qx", "qy", "qz", "qw")
MOVING, TURNING = ("vx", "vy", "vz"), ("wx", "wy", "wz")


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageKind:
    """A type of message: the columns of its rows behind ``t`` and ``logged``, those of texts, and what makes the rows.

    ``rows`` gives for each row of a message its header, and the cells.
    """

    numbers: tuple[str, ...]
    texts: tuple[str, ...] = ("frame",)
    rows: Callable[[Any], Iterator[tuple[Any, Cells, Cells]]]


def _vector(found: Any) -> Cells:
    return (found.x, found.y, found.z)


def _turn(found: Any) -> Cells:
    return (found.x, found.y, found.z, found.w)


def _pose(found: Any) -> Cells:
    return (*_vector(found.position), *_turn(found.orientation))


def _single(cells: Callable[[Any], Cells], texts: Callable[[Any], Cells] = lambda m: (m.header.frame_id,)) -> Any:
    """The one row of a message with a header."""

    def rows(message: Any) -> Iterator[tuple[Any, Cells, Cells]]:
        yield message.header, cells(message), texts(message)

    return rows


def _both_frames(message: Any) -> Cells:
    return (message.header.frame_id, message.child_frame_id)


def _transform(message: Any) -> Cells:
    found = message.transform
    return (*_vector(found.translation), *_turn(found.rotation))


def _transforms(message: Any) -> Iterator[tuple[Any, Cells, Cells]]:
    for each in message.transforms:
        yield each.header, _transform(each), _both_frames(each)


def _odometry(message: Any) -> Cells:
    twist = message.twist.twist
    return (*_pose(message.pose.pose), *_vector(twist.linear), *_vector(twist.angular))


def _imu(message: Any) -> Cells:
    return (
        *_turn(message.orientation),
        *_vector(message.angular_velocity),
        *_vector(message.linear_acceleration),
    )


def _fix(message: Any) -> Cells:
    return (message.latitude, message.longitude, message.altitude, message.status.status)


def _range(message: Any) -> Cells:
    return (message.range, message.min_range, message.max_range, message.field_of_view)


FRAMES = ("frame", "child")
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Two names of lists of transforms, which not all collections of ROS 1's definitions have."""

KINDS: Mapping[str, MessageKind] = MappingProxyType(
    {
        "geometry_msgs/msg/PoseStamped": MessageKind(numbers=(*POSITION, *TURN), rows=_single(lambda m: _pose(m.pose))),
        "geometry_msgs/msg/PoseWithCovarianceStamped": MessageKind(
            numbers=(*POSITION, *TURN), rows=_single(lambda m: _pose(m.pose.pose))
        ),
        "geometry_msgs/msg/PointStamped": MessageKind(numbers=POSITION, rows=_single(lambda m: _vector(m.point))),
        "geometry_msgs/msg/TransformStamped": MessageKind(
            numbers=(*POSITION, *TURN), texts=FRAMES, rows=_single(_transform, _both_frames)
        ),
        **dict.fromkeys(TRANSFORMS, MessageKind(numbers=(*POSITION, *TURN), texts=FRAMES, rows=_transforms)),
        "nav_msgs/msg/Odometry": MessageKind(
            numbers=(*POSITION, *TURN, *MOVING, *TURNING), texts=FRAMES, rows=_single(_odometry, _both_frames)
        ),
        "sensor_msgs/msg/Imu": MessageKind(numbers=(*TURN, *TURNING, "ax", "ay", "az"), rows=_single(_imu)),
        "sensor_msgs/msg/NavSatFix": MessageKind(
            numbers=("latitude", "longitude", "altitude", "status"), rows=_single(_fix)
        ),
        "sensor_msgs/msg/Range": MessageKind(
            numbers=("range", "min_range", "max_range", "field_of_view"), rows=_single(_range)
        ),
    }
)
"""The types of messages that make tables."""


def decoder(encoding: str, kind: str, digest: str | None) -> Callable[[bytes], Any]:
    """What makes messages of bytes, by the definitions that ROS has of its types; those in files are not run.

    Raises:
        ValueError: the file means another type of this name; so does what is handed back, for bytes that are none.

    """
    from rosbags.serde import SerdeError
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if encoding == "cdr":
        store = get_typestore(Stores.ROS2_HUMBLE)
    else:
        store = get_typestore(Stores.ROS1_NOETIC)
        if kind in TRANSFORMS and kind not in store.types:
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
        if digest is not None and store.generate_msgdef(kind)[1] != digest:
            raise ValueError(f"its definition of `{kind}` is not that of ROS")
    read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1

    def message_of(data: bytes) -> Any:
        try:
            return read(data, kind)
        except SerdeError as error:
            raise ValueError(str(error)) from None

    return message_of


def supported() -> Sequence[str]:
    """The types of messages that make tables, by their short names."""
    return tuple(kind.rpartition("/")[2] for kind in KINDS)


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
