"""Makes raw tables from files, one format per file; ``READERS`` has the formats by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from mbm.data.types import AnyReader

_TABLES = ("csv", "tsv", "json", "npz", "parquet", "matrix")
_RECORDS = ("tum", "kitti", "euroc", "bal", "g2o", "bundler", "colmap", "opencv", "kalibr", "rosbag")
_IMAGES = ("chessboard", "circles", "charuco", "aruco", "apriltag", "contour", "image")
_NAMES = (*_TABLES, *_RECORDS, *_IMAGES)
"""The formats, each in a file of its name that exports ``READER``."""


class _Readers(Mapping[str, AnyReader]):
    """The readers by name; each is loaded when it is first asked for."""

    def __getitem__(self, name: str) -> AnyReader:
        if name not in _NAMES:
            raise KeyError(name)
        reader: AnyReader = import_module(f"{__name__}.{name}").READER
        return reader

    def __contains__(self, name: object) -> bool:
        return name in _NAMES

    def __iter__(self) -> Iterator[str]:
        return iter(_NAMES)

    def __len__(self) -> int:
        return len(_NAMES)


READERS: Mapping[str, AnyReader] = _Readers()
