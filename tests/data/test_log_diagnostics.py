"""What is said, in a problem, of logs of ROS that are none, or lack what is asked for."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

import mbm


def record(code: int, body: bytes) -> bytes:
    return bytes([code]) + struct.pack("<Q", len(body)) + body


EMPTY = b"\x89MCAP0\r\n" + record(1, bytes(8)) + record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n"
"""A sound MCAP file without topics: header, end of the data, footer."""


@pytest.mark.parametrize(
    ("content", "code", "said"),
    [
        (b"no log of anything", "malformed-bag", "is no log of ROS"),
        (EMPTY[:30], "malformed-bag", "is no log of ROS"),
        (EMPTY, "no-topic", "has no topic `/odom`"),
    ],
)
def test_what_is_wrong_is_said_of_the_file(content: bytes, code: str, said: str, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("mcap")
    (tmp_path / "f.mcap").write_bytes(content)
    problem = tmp_path / "p.mbm"
    problem.write_text('(problem p (data t (rosbag "f.mcap" "/odom")) (unknowns (m)) (observe t (= x m)))')
    with pytest.raises(mbm.MbmError) as raised:
        mbm.load(problem).solve()
    (fault,) = raised.value.diagnostics
    assert fault.code.name == code
    assert said in fault.message
