"""What is stored in bags of ROS 1 (``.bag``) and in MCAP files: messages as bytes, with their topics and types.

The library of each format reads its records. Chunks are unpacked here, since libraries take whatever one unpacks to.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from io import BytesIO
from typing import Any

from mbm.values import dataclass

DAMAGED = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    struct.error,
)
"""What libraries raise, beside errors of their own, where bytes are not what they should be."""


class BagError(Exception):
    """What is wrong with a bag, in words."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Topic:
    """Messages of one topic: ``kind`` as in ``nav_msgs/msg/Odometry``, ``encoding`` ``ros1`` or ``cdr``.

    ``digest`` is that of the definition in ROS 1 (None: not known), ``messages`` (time of logging in ns, bytes) in the
    order of that time.
    """

    kind: str
    encoding: str
    digest: str | None
    messages: tuple[tuple[int, bytes], ...]


class _Unpacker:
    """Unpacks chunks, to ``most`` bytes in all."""

    def __init__(self, most: int) -> None:
        self._left = most

    def __call__(self, method: str, data: bytes) -> bytes:
        """The bytes of a chunk packed by ``bz2``, ``lz4``, ``zstd`` or not at all."""
        if method == "bz2":
            found = bz2.BZ2Decompressor().decompress(data, max_length=self._left + 1)
        elif method == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            found = LZ4FrameDecompressor().decompress(data, max_length=self._left + 1)
        elif method == "zstd":
            from zstandard import ZstdDecompressor, ZstdError

            try:
                found = ZstdDecompressor().stream_reader(BytesIO(data)).read(self._left + 1)
            except ZstdError as error:
                raise BagError(_reason(error)) from None
        elif method in ("", "none"):
            found = data
        else:
            message = f"its chunks are packed by `{method[:20]}`, which is not known"
            raise BagError(message)
        self._left -= len(found)
        if self._left < 0:
            message = "its chunks unpack to more than measurements do"
            raise BagError(message)
        return bytes(found)


class _Bytes:
    """The content of a file, in the place of its path."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def exists(self) -> bool:
        """It was read."""
        return True

    def open(self, _mode: str) -> BytesIO:
        """A stream of the bytes."""
        return BytesIO(self._content)


def topics_of_bag(content: bytes, most: int) -> tuple[Mapping[str, str], Callable[[str], Topic]]:
    """The topics of a ROS 1 bag with their types, and what reads the messages of one; to ``most`` bytes unpacked.

    Raises:
        BagError: it is damaged.

    """
    from rosbags.rosbag1 import Reader, ReaderError

    try:
        reader = Reader(_Bytes(content))
        reader.open()
        unpack = _Unpacker(most)
        for place, chunk in reader.chunks.items():
            method = _method(chunk.decompressor)
            reader.chunks[place] = chunk._replace(decompressor=lambda data, method=method: unpack(method, data))
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
    except (ReaderError, *DAMAGED) as error:
        raise BagError(_reason(error)) from None

    def messages(topic: str) -> Topic:
        own = [c for c in reader.connections if c.topic == topic]
        try:
            found = tuple((time, data) for _, time, data in reader.messages(connections=own)) if own else ()
        except (ReaderError, *DAMAGED) as error:
            raise BagError(_reason(error)) from None
        digests = {connection.digest for connection in own}
        digest = digests.pop() if len(digests) == 1 else None
        return Topic(kind=kinds[topic], encoding="ros1", digest=digest, messages=found)

    return kinds, messages


def _method(decompressor: object) -> str:
    """How a chunk of ROS 1 is packed, by where the function comes from that would unpack it."""
    module = str(getattr(decompressor, "__module__", ""))
    return next((method for method in ("bz2", "lz4") if module.startswith(method)), "none")


def topics_of_mcap(content: bytes, most: int) -> tuple[Mapping[str, str], Callable[[str], Topic]]:
    """The same of an MCAP file, which needs no index.

    Raises:
        BagError: it is damaged.

    """
    from mcap.exceptions import McapError

    try:
        return _of_mcap(content, most)
    except (McapError, *DAMAGED) as error:
        raise BagError(_reason(error)) from None


def _of_mcap(content: bytes, most: int) -> tuple[Mapping[str, str], Callable[[str], Topic]]:
    from mcap.records import Channel, Message, Schema

    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, int, str]] = {}
    logged: dict[int, list[tuple[int, bytes]]] = {}
    for record in _records(content, most):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = (record.topic, record.schema_id, record.message_encoding)
        elif isinstance(record, Message):
            logged.setdefault(record.channel_id, []).append((record.log_time, record.data))
    kinds = {topic: _full(schemas.get(schema, "")) for topic, schema, _ in channels.values()}

    def messages(topic: str) -> Topic:
        own = [number for number, (name, _, _) in channels.items() if name == topic]
        encodings = {channels[number][2] for number in own}
        if len(encodings) != 1 or encodings - {"ros1", "cdr"}:
            raise BagError(f"messages of `{topic[:40]}` are in none of the encodings of ROS (`ros1`, `cdr`)")
        found = sorted((each for number in own for each in logged.get(number, ())), key=lambda each: each[0])
        return Topic(kind=kinds[topic], encoding=encodings.pop(), digest=None, messages=tuple(found))

    return kinds, messages


def _records(content: bytes, most: int) -> Iterator[Any]:
    """The records of an MCAP file, those in chunks too."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    unpack = _Unpacker(most)
    for record in StreamReader(BytesIO(content), emit_chunks=True).records:
        if isinstance(record, Chunk):
            data = unpack(record.compression, record.data)
            yield from breakup_chunk(replace(record, compression="", data=data, uncompressed_size=len(data)))
        else:
            yield record


def _full(name: str) -> str:
    """``nav_msgs/msg/Odometry``, as ROS 2 writes what ROS 1 calls ``nav_msgs/Odometry``."""
    package, _, kind = name.partition("/")
    return name if "/" in kind else f"{package}/msg/{kind}"


def _reason(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return text[0][:120] if text else type(error).__name__
