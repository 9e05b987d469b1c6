"""Messages of ROS → columns of numbers: which fields of which types, by the names that other formats have for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeAlias

from mbm.problem.tables import POSITION
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
