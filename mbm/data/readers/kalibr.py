"""Kalibr's camera chains (``camchain.yaml``; Furgale, Rehder, Siegwart 2013): cameras, and how they stand to another.

``:cameras`` has a row for each camera; parameters that its models lack are gaps. ``:transforms`` has the poses
``T_cn_cnm1`` (of the camera before, seen from this one) and ``T_cam_imu``: points of ``from`` come to ``to``. Rows are
the lines where an entry begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mbm.data.readers import faults as format_faults
from mbm.data.readers.fields import LARGEST_DEVIATION, line_numbers, number_columns
from mbm.data.readers.scenes import POSE
from mbm.data.readers.yaml_nodes import Document, Items, Node, Scalar, entries_of, numbers_in, read_document
from mbm.data.types import ManyReader, RawTable
from mbm.problem.tables import Column, Numbers
from mbm.rotations import quaternion_of_matrix
from mbm.text.types import DataPlace, MbmError

MODELS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "pinhole": ("fx", "fy", "cx", "cy"),
        "omni": ("xi", "fx", "fy", "cx", "cy"),
        "ds": ("xi", "alpha", "fx", "fy", "cx", "cy"),
        "eucm": ("alpha", "beta", "fx", "fy", "cx", "cy"),
    }
)
"""The intrinsics of a camera model in the order of files, as Kalibr's documentation has them."""

DISTORTIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"radtan": ("k1", "k2", "p1", "p2"), "equidistant": ("k1", "k2", "k3", "k4"), "fov": ("w",), "none": ()}
)
"""The coefficients of a distortion model."""

BEFORE, IMU = "T_cn_cnm1", "T_cam_imu"


def read(path: Path) -> Mapping[str, RawTable | MbmError]:
    """Read a camera chain.

    Raises MbmError as ``read_document`` does, and malformed-yaml; in the place of the transforms no-records.
    """
    document = read_document(path, "the format `kalibr`")
    cameras = {
        name: entries_of(node, document, f"`{name}`")
        for name, node in entries_of(document.root, document, "the file").items()
        if name.startswith("cam") and name[3:].isdigit()
    }
    if not cameras:
        raise MbmError(format_faults.no_records(DataPlace(file=document.path), "cameras `cam0`, `cam1` …"))
    lines = {name: node.line for name, node in entries_of(document.root, document, "the file").items()}
    return {"cameras": _cameras(cameras, lines, document), "transforms": _transforms(cameras, document)}


def _cameras(cameras: Mapping[str, Mapping[str, Node]], lines: Mapping[str, int], document: Document) -> RawTable:
    texts: dict[str, list[str]] = {"camera": list(cameras), "model": [], "distortion": []}
    values: list[dict[str, float]] = []
    for name, entries in cameras.items():
        found: dict[str, float] = {}
        size = _numbers(entries, "resolution", name, document, lines[name])
        found.update(_by_name(("width", "height"), size, f"`resolution` of `{name}`", document, lines[name]))
        kinds = (
            ("model", "camera_model", "intrinsics", MODELS),
            ("distortion", "distortion_model", "distortion_coeffs", DISTORTIONS),
        )
        for column, key, coefficients, known in kinds:
            kind = entries.get(key)
            text = kind.text if isinstance(kind, Scalar) else ""
            if text not in known:
                said = f"`{key}` of `{name}` is {format_faults.shown(text)}; those that are read are {', '.join(known)}"
                raise document.fault(lines[name] if kind is None else kind.line, said)
            texts[column].append(text)
            numbers = _numbers(entries, coefficients, name, document, lines[name]) if known[text] else []
            found.update(_by_name(known[text], numbers, f"`{coefficients}` of `{name}`", document, lines[name]))
        values.append(found)
    names = list(dict.fromkeys(name for found in values for name in found))
    table = np.array([[found.get(name, np.nan) for name in names] for found in values])
    columns = (*(Column(name=n, texts=tuple(cells)) for n, cells in texts.items()), *number_columns(names, table))
    rows = line_numbers(lines[name] for name in cameras)
    return RawTable(path=document.path, sha256=document.sha256, columns=columns, file_rows=rows, key="camera")


def _numbers(entries: Mapping[str, Node], key: str, camera: str, document: Document, line: int) -> list[float]:
    if key not in entries:
        raise document.fault(line, f"`{camera}` has no `{key}`")
    return numbers_in(entries[key], document, f"`{key}` of `{camera}`")


def _by_name(
    names: tuple[str, ...], numbers: list[float], what: str, document: Document, line: int
) -> dict[str, float]:
    if len(names) != len(numbers):
        raise document.fault(line, f"{what} are {' '.join(names)}, and here are {len(numbers)} numbers")
    return dict(zip(names, numbers, strict=True))


def _transforms(cameras: Mapping[str, Mapping[str, Node]], document: Document) -> RawTable | MbmError:
    ends, poses, rows = [], [], []
    before = None
    for name, entries in cameras.items():
        for key, origin in ((BEFORE, before), (IMU, "imu")):
            node = entries.get(key)
            if node is None:
                continue
            if origin is None:
                raise document.fault(node.line, f"`{name}` has `{key}`, and no camera stands before it")
            ends.append((origin, name))
            poses.append(_pose(node, f"`{key}` of `{name}`", document))
            rows.append(node.line)
        before = name
    if not ends:
        return MbmError(format_faults.no_records(DataPlace(file=document.path), f"`{BEFORE}` or `{IMU}`"))
    columns = (
        Column(name="from", texts=tuple(origin for origin, _ in ends)),
        Column(name="to", texts=tuple(name for _, name in ends)),
        *number_columns(POSE, np.array(poses)),
    )
    return RawTable(path=document.path, sha256=document.sha256, columns=columns, file_rows=line_numbers(rows))


def _pose(node: Node, what: str, document: Document) -> Numbers:
    """Quaternion and translation (7,) of a 4×4 matrix."""
    rows = [numbers_in(row, document, what) for row in node.items] if isinstance(node, Items) else []
    if [len(row) for row in rows] != [4, 4, 4, 4]:
        raise document.fault(node.line, f"{what} is no 4×4 matrix")
    matrix = np.array(rows)
    rotation = matrix[:3, :3]
    with np.errstate(all="ignore"):
        deviation = np.abs(rotation.T @ rotation - np.eye(3)).max()
        turned = bool(deviation < LARGEST_DEVIATION) and float(np.linalg.det(rotation)) > 0
    if not turned or rows[3] != [0, 0, 0, 1]:
        raise document.fault(node.line, f"{what} is no rotation and translation")
    return np.concatenate([quaternion_of_matrix(rotation[None])[0], matrix[:3, 3]])


READER = ManyReader(name="kalibr", extensions=(), parts=("cameras", "transforms"), read=read)
