"""Logs of ROS: what the reader takes from bags that rosbags wrote, and what it says of others and of damaged ones."""

from __future__ import annotations

import struct

import numpy as np
import pytest

import mbm
from mbm.data.readers import READERS
from mbm.data.types import asked
from mbm.text.types import MbmError

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as FolderWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
STAMP = 1_700_000_000
COLUMNS = {
    "/pose": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "/tf": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "/odom": ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"),
    "/point": ("x", "y", "z"),
    "/imu": ("qx", "qy", "qz", "qw", "wx", "wy", "wz", "ax", "ay", "az"),
    "/fix": ("latitude", "longitude", "altitude", "status"),
    "/range": ("range", "min_range", "max_range", "field_of_view"),
    "/transform": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "/located": ("x", "y", "z", "qx", "qy", "qz", "qw"),
}


def messages(store, i):
    """One message of each kind; its numbers are 100 i + 1, 2, 3 … in the order of the columns (angles aside)."""
    types = store.types

    def make(name, *fields):
        return types[name](*fields)

    time = make("builtin_interfaces/msg/Time", STAMP + i, 500_000_000)
    fields = types["std_msgs/msg/Header"].__dataclass_fields__
    header = make("std_msgs/msg/Header", *((i,) if "seq" in fields else ()), time, "map")
    n = [100.0 * i + k for k in range(1, 14)]

    def vector(name, first):
        return make(f"geometry_msgs/msg/{name}", *n[first : first + 3])

    turn = make("geometry_msgs/msg/Quaternion", *n[3:7])
    pose = make("geometry_msgs/msg/Pose", vector("Point", 0), turn)
    transform = make("geometry_msgs/msg/Transform", vector("Vector3", 0), turn)
    stamped = make("geometry_msgs/msg/TransformStamped", header, "base", transform)
    twist = make("geometry_msgs/msg/Twist", vector("Vector3", 7), vector("Vector3", 10))
    nine, many = np.zeros(9), np.zeros(36)
    spread = make("geometry_msgs/msg/PoseWithCovariance", pose, many)
    moving = make("geometry_msgs/msg/TwistWithCovariance", twist, many)
    own = make("geometry_msgs/msg/Quaternion", *n[0:4])
    status = make("sensor_msgs/msg/NavSatStatus", int(n[3]) % 100, 1)
    sensor = "sensor_msgs/msg/"
    return {
        "/pose": make("geometry_msgs/msg/PoseStamped", header, pose),
        "/tf": make("tf2_msgs/msg/TFMessage", [stamped, stamped]),
        "/odom": make("nav_msgs/msg/Odometry", header, "base", spread, moving),
        "/point": make("geometry_msgs/msg/PointStamped", header, vector("Point", 0)),
        "/imu": make(f"{sensor}Imu", header, own, nine, vector("Vector3", 4), nine, vector("Vector3", 7), nine),
        "/fix": make(f"{sensor}NavSatFix", header, status, *n[0:3], nine, 0),
        "/range": make(f"{sensor}Range", header, 0, n[3], n[1], n[2], n[0]),
        "/transform": stamped,
        "/located": make("geometry_msgs/msg/PoseWithCovarianceStamped", header, spread),
        "/text": make("std_msgs/msg/String", "words"),
    }


def expected(topic, i):
    n = [100.0 * i + k for k in range(1, 14)]
    if topic == "/fix":
        return [*n[:3], n[3] % 100]
    return n[: len(COLUMNS[topic])]


def bag(folder, compression=None, count=3):
    path = folder / "log.bag"
    writer = BagWriter(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        connections = {t: writer.add_connection(t, m.__msgtype__, typestore=ROS1) for t, m in messages(ROS1, 0).items()}
        for i in range(count):
            for topic, message in messages(ROS1, i).items():
                data = ROS1.serialize_ros1(message, message.__msgtype__)
                writer.write(connections[topic], (STAMP + i) * 10**9, data)
    return path


def mcap(folder, compressed=False, count=3):
    writer = FolderWriter(folder / "log", version=9, storage_plugin=StoragePlugin.MCAP)
    if compressed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {t: writer.add_connection(t, m.__msgtype__, typestore=ROS2) for t, m in messages(ROS2, 0).items()}
        for i in range(count):
            for topic, message in messages(ROS2, i).items():
                data = ROS2.serialize_cdr(message, message.__msgtype__)
                writer.write(connections[topic], (STAMP + i) * 10**9, data)
    (path,) = (folder / "log").glob("*.mcap")
    return path


WRITERS = {
    "ROS 1": bag,
    "ROS 1, bz2": lambda folder, **more: bag(folder, BagWriter.CompressionFormat.BZ2, **more),
    "ROS 1, lz4": lambda folder, **more: bag(folder, BagWriter.CompressionFormat.LZ4, **more),
    "MCAP": mcap,
    "MCAP, zstd": lambda folder, **more: mcap(folder, compressed=True, **more),
}


def read(path, topic):
    return asked(READERS["rosbag"].read(path)[topic])


@pytest.mark.parametrize("kind", WRITERS)
def test_every_kind_of_message_makes_its_columns(kind, tmp_path):
    path = WRITERS[kind](tmp_path)
    tables = READERS["rosbag"].read(path)
    assert set(tables) == set(COLUMNS)
    for topic, names in COLUMNS.items():
        table = asked(tables[topic])
        columns = {column.name: column for column in table.columns}
        assert set(columns) == {"t", "logged", *names, "frame"} | ({"child"} if "child" in columns else set())
        each = 2 if topic == "/tf" else 1
        assert len(table.file_rows) == 3 * each
        found = np.column_stack([columns[name].numbers for name in names])
        wanted = [expected(topic, i) for i in range(3) for _ in range(each)]
        np.testing.assert_array_equal(found, wanted)
        # half a second, exact to a double of that size
        np.testing.assert_allclose(columns["t"].numbers[::each], STAMP + np.arange(3) + 0.5, rtol=1e-15)
        np.testing.assert_allclose(columns["logged"].numbers[::each], STAMP + np.arange(3), rtol=1e-15)
        assert set(columns["frame"].texts) == {"map"}


@pytest.mark.parametrize("kind", ["ROS 1", "MCAP"])
def test_a_problem_reads_a_topic(kind, tmp_path):
    path = WRITERS[kind](tmp_path)
    text = f"""
    (problem p
      (data odom (rosbag "{path.as_posix()}" "/odom"))
      (unknowns (a))
      (observe odom (= x (* a vx)) :sigma 1)
      (derive (n (count odom (= child "base")))))"""
    solved = mbm.loads(text).solve()
    x, v = (np.array([expected("/odom", i)[k] for i in range(3)]) for k in (0, 7))
    assert float(solved["a"].value) == pytest.approx(x @ v / (v @ v))
    assert float(solved["n"].value) == 3


@pytest.mark.parametrize(
    ("topic", "words"),
    [("/pos", "has no topic `/pos`"), ("/text", "of the type `std_msgs/msg/String`"), ("", "has no topic")],
)
def test_topics_that_make_no_table(topic, words, tmp_path):
    with pytest.raises(MbmError) as caught:
        read(mcap(tmp_path), topic)
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "no-topic"
    assert words in fault.message
    assert topic != "/pos" or "`/pose`" in fault.hint


def test_a_topic_without_messages_holds_none(tmp_path):
    with pytest.raises(MbmError) as caught:
        read(mcap(tmp_path, count=0), "/pose")
    assert {d.code.name for d in caught.value.diagnostics} <= {"no-records", "no-topic"}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_damaged_log_is_told_or_read_as_far_as_it_is_sound(kind, tmp_path):
    path = WRITERS[kind](tmp_path)
    content = path.read_bytes()
    random = np.random.default_rng(1)
    damaged = [content[:size] for size in random.integers(1, len(content), 12)]
    for _ in range(40):
        spoiled = bytearray(content)
        for place in random.integers(0, len(content), 3):
            spoiled[place] = int(random.integers(0, 256))
        damaged.append(bytes(spoiled))
    for place in random.integers(0, len(content) - 8, 20):
        spoiled = bytearray(content)
        spoiled[place : place + 8] = b"\xff" * 8  # huge counts and lengths
        damaged.append(bytes(spoiled))
    other = tmp_path / f"damaged{path.suffix}"
    for each in damaged:
        other.write_bytes(each)
        try:
            table = read(other, "/odom")
        except MbmError as error:
            assert {d.code.name for d in error.diagnostics} <= {"malformed-bag", "no-topic", "no-records"}
        else:
            assert all(len(column.numbers) == len(table.file_rows) for column in table.columns if not column.is_text)


@pytest.mark.parametrize("content", [b"nothing of the kind", b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"\0" * 100])
def test_what_is_no_log(content, tmp_path):
    path = tmp_path / "log.bag"
    path.write_bytes(content)
    with pytest.raises(MbmError) as caught:
        read(path, "/pose")
    assert {d.code.name for d in caught.value.diagnostics} <= {"malformed-bag", "no-topic"}


def test_a_chunk_that_unpacks_to_too_much_is_refused(tmp_path):
    import zstandard

    def record(code, body):
        return bytes([code]) + struct.pack("<Q", len(body)) + body

    packed = zstandard.compress(bytes(400_000_000))
    chunk = struct.pack("<QQQI", 0, 0, 400_000_000, 0) + struct.pack("<I", 4) + b"zstd"
    chunk += struct.pack("<Q", len(packed)) + packed
    header = record(1, struct.pack("<I", 0) + struct.pack("<I", 0))
    path = tmp_path / "log.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + header + record(6, chunk))
    with pytest.raises(MbmError) as caught:
        read(path, "/pose")
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "malformed-bag"
    assert "unpack to more" in fault.message


def test_another_definition_of_a_known_type_is_not_trusted(tmp_path):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64 x", "geometry_msgs/msg/PointStamped"))
    path = tmp_path / "log.bag"
    with BagWriter(path) as writer:
        kind = "geometry_msgs/msg/PointStamped"
        connection = writer.add_connection("/point", kind, typestore=store)
        writer.write(connection, 1, store.serialize_ros1(store.types[kind](1.0), kind))
    with pytest.raises(MbmError) as caught:
        read(path, "/point")
    assert "is not that of ROS" in caught.value.diagnostics[0].message


def test_without_the_libraries_the_extra_is_named(tmp_path, monkeypatch):
    import sys

    path = mcap(tmp_path)
    monkeypatch.setitem(sys.modules, "mcap.exceptions", None)
    with pytest.raises(MbmError) as caught:
        read(path, "/pose")
    (fault,) = caught.value.diagnostics
    assert fault.code.name == "missing-extra"
    assert "mbm[logs]" in fault.hint
