"""A sound file of each format that mbm reads, and files that are damaged, lie about their sizes, or unpack to much."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
import zipfile
from collections.abc import Callable
from functools import cache

import numpy as np

from tests.fuzz.mutations import CELL, ODD_CELLS, mutated_text
from tests.hostile.texts import CONTROLS, FOREIGN, word
from tests.trials.choices import Choices

ROWS = 6
NUMBERS = [round(0.5 * i - 1.25, 4) for i in range(ROWS)]
TEXTS = ["p", "q", "p", "é", "a b", "q"]
POSE = "0.1 0.2 0.3 0 0 0 1"
PACKERS: dict[str, Callable[[bytes], bytes]] = {".gz": gzip.compress, ".bz2": bz2.compress, ".xz": lzma.compress}


def _rows(separator: str) -> bytes:
    lines = [separator.join(("x", "y", "name"))]
    lines += [separator.join((str(i), str(v), t)) for i, (v, t) in enumerate(zip(NUMBERS, TEXTS, strict=True))]
    return ("\n".join(lines) + "\n").encode()


@cache
def sound(kind: str) -> bytes:
    """A file of a format (``bal``, ``g2o`` and the like hold whole scenes)."""
    match kind:
        case "csv" | "tsv":
            return _rows("," if kind == "csv" else "\t")
        case "json":
            return json.dumps({"x": list(range(ROWS)), "y": NUMBERS, "name": TEXTS}).encode()
        case "npz":
            stream = io.BytesIO()
            np.savez_compressed(stream, x=np.arange(float(ROWS)), y=np.array(NUMBERS), name=np.array(TEXTS))
            return stream.getvalue()
        case "parquet":
            import pyarrow
            from pyarrow import parquet

            stream = io.BytesIO()
            table = pyarrow.table({"x": np.arange(float(ROWS)), "y": NUMBERS, "name": TEXTS})
            parquet.write_table(table, stream)
            return stream.getvalue()
        case "tum":
            return "".join(f"{i} {POSE}\n" for i in range(ROWS)).encode()
        case "kitti":
            return "".join(f"1 0 0 {i} 0 1 0 2 0 0 1 3\n" for i in range(ROWS)).encode()
        case "euroc":
            return "".join(f"{1403636580838555648 + i},1,2,3,1,0,0,0\n" for i in range(ROWS)).encode()
        case "bal":
            seen = "".join(f"{i % 2} {i % 3} {i}.5 -{i}.25\n" for i in range(6))
            return ("2 3 6\n" + seen + "\n".join(str(0.1 * i) for i in range(2 * 9 + 3 * 3)) + "\n").encode()
        case "bundler":
            camera = "500 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 -4\n"
            points = "".join(f"0.{i} 0 0\n9 9 9\n2 0 {i} {i}.5 1 1 {i} 2 3\n" for i in range(3))
            return ("# Bundle file v0.3\n2 3\n" + 2 * camera + points).encode()
        case "opencv":
            matrix = "!!opencv-matrix\n   rows: 3\n   cols: 2\n   dt: d\n   data: [ 1., 2., 3., 4., 5.5, .7 ]\n"
            return f"%YAML:1.0\n---\nflags: 3\nK: {matrix}sizes: [ 9, 6 ]\n".encode()
        case "kalibr":
            pose = "".join(f"  - [{row}]\n" for row in ("1, 0, 0, 0.5", "0, 1, 0, 0.1", "0, 0, 1, 0", "0, 0, 0, 1"))
            camera = (
                "  camera_model: pinhole\n  distortion_coeffs: [-0.28, 0.07, 0, 0]\n  distortion_model: radtan\n"
                "  intrinsics: [458.5, 457.2, 367.5, 248.2]\n  resolution: [752, 480]\n"
            )
            return f"cam0:\n{camera}cam1:\n{camera}  T_cn_cnm1:\n{pose}".encode()
        case _:
            nodes = "".join(f"VERTEX_SE2 {i} {i} 0 0.1\n" for i in range(4))
            edges = "".join(f"EDGE_SE2 {i} {i + 1} 1 0 0.1 1 0 0 1 0 1\n" for i in range(3))
            return (nodes + edges).encode()


SOURCES = {
    **{kind: (f'(data d ({kind} "d.{kind}"))', "(observe d (= y (+ a (* b x))) :sigma 1)") for kind in
       ("csv", "tsv", "json", "npz", "parquet")},
    **{kind: (f'(data d ({kind} "d.{kind}"))', "(observe d (= x (+ a (* b t))) :sigma 1)") for kind in
       ("tum", "kitti", "euroc")},
    "bal": (
        '(data c (bal "d.bal" :cameras)) (data q (bal "d.bal" :points)) (data d (bal "d.bal" :observations))',
        "(observe d (= u (+ a (* b v))) :sigma 1) (observe c (= f a) :sigma 1) (observe q (= x b) :sigma 1)",
    ),
    "bundler": (
        '(data c (bundler "d.bundler" :images)) (data d (bundler "d.bundler" :observations))',
        "(observe d (= u (+ a (* b v))) :sigma 1) (observe c (= z a) :sigma 1)",
    ),
    "opencv": ('(data d (opencv "d.opencv" "K"))', "(observe d (= c1 (+ a (* b c2))) :sigma 1)"),
    "kalibr": (
        '(data d (kalibr "d.kalibr" :cameras)) (data e (kalibr "d.kalibr" :transforms))',
        "(observe d (= fx (+ a (* b fy))) :sigma 1) (observe e (= x a) :sigma 1)",
    ),
    "g2o": (
        '(data n (g2o "d.g2o" :vertices)) (data d (g2o "d.g2o" :edges))',
        "(observe d (= dx (+ a (* b dtheta))) :sigma 1) (observe n (= x a) :sigma 1)",
    ),
}  # fmt: skip
"""By format: the clauses that read the file, and equations for two unknowns."""


def problem(kind: str, ending: str = "") -> str:
    """A problem that reads ``d.<kind>`` with an ending behind it."""
    data, equations = SOURCES[kind]
    return f"(problem p {data} (unknowns (a :init 1) (b :init 1)) {equations})".replace(
        f'"d.{kind}"', f'"d.{kind}{ending}"'
    )


def npy(header: bytes, body: bytes = b"") -> bytes:
    """An archive with one array, whose header says what it likes."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("y.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + body)
        file.writestr("x.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + body)
    return stream.getvalue()


def bomb(kind: str, choices: Choices) -> bytes:
    """Much in little: zeros packed, counts in the billions, depth."""
    many = choices.one_of((10**5, 10**7, 10**9, 2**63, 10**19, -1))
    match kind:
        case "npz":
            shape = choices.one_of((f"({many},)", f"({many}, 2)", "(2, 3)", "()", f"({many}, {many})"))
            kinds = choices.one_of(("'<f8'", "'|O'", "'<U9'", "'<c16'", "[('a', '<f8')]", "'<f9'", "'|S1000000'"))
            header = f"{{'descr': {kinds}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
            return npy(header, bytes(10 ** choices.below(7)))
        case "json":
            return choices.one_of(
                (
                    b"[" * 10 ** choices.below(6),
                    b'{"y":' * 10 ** choices.below(5) + b"1",
                    json.dumps({f"c{i}": [1] for i in range(10 ** choices.below(5))}).encode(),
                    b'{"x": [' + b"9" * 10 ** choices.below(6) + b"]}",
                    b'{"x": [1], "x": [2], "y": [1e999]}',
                    b'{"x": "' + b"a" * 10 ** choices.below(6) + b'"}',
                )
            )
        case "bal":
            return f"{many} {choices.one_of((many, 3))} {choices.one_of((many, 6))}\n0 0 1 2\n".encode()
        case "bundler":
            return f"{many} {choices.one_of((many, 3))}\n0 0 0\n".encode()
        case "opencv" | "kalibr":
            billions = "a: &a [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]\n" + "".join(
                f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 10)}]\n" for i in range(9)
            )
            return choices.one_of(
                (
                    f"K: !!opencv-matrix\n   rows: {many}\n   cols: {many}\n   dt: d\n   data: [ 1. ]\n",
                    billions,
                    "cam0: " + "[" * 10 ** choices.below(5),
                    "K: !!python/object/apply:os.system [ 'true' ]\n",
                    "cam0:\n  intrinsics: [" + ", ".join(["1"] * 10 ** choices.below(5)) + "]\n",
                    "K: " + "9" * 10 ** choices.below(6) + "\n",
                )
            ).encode()
        case "g2o":
            return f"VERTEX_SE2 {many} 0 0 0\nEDGE_SE2 {many} 0 1 0 0 1 0 0 1 0 1\n".encode()
        case "csv" | "tsv":
            wide = ("," if kind == "csv" else "\t").join(f"c{i}" for i in range(10 ** choices.below(5)))
            return choices.one_of(
                (wide.encode() + b"\n1", b'x,y\n"' + b"a" * 10 ** choices.below(6), b"\n" * 10**5, wide.encode())
            )
        case _:
            return choices.one_of(
                (b"0 " * 10 ** choices.below(6), b"9" * 10 ** choices.below(6) + b" 1 2 3 4 5 6 7\n", bytes(10**5))
            )


def hostile_content(kind: str, choices: Choices) -> bytes:
    """A file of a format: damaged, cut, with odd cells, of another format, or a bomb."""
    content = sound(kind)
    match choices.below(7):
        case 0:
            return bomb(kind, choices)
        case 1:
            return sound(choices.one_of(tuple(SOURCES)))
        case 2:
            return content[: choices.below(len(content) + 1)]
        case 3 | 4:
            if kind in ("npz", "parquet"):
                return _flipped(content, choices)
            odd = [*ODD_CELLS, *CONTROLS, *FOREIGN, word(choices), "-1", "1e999", "9" * 400]
            return mutated_text(content.decode(), choices, CELL, odd).encode("utf-8", "surrogatepass")
        case 5:
            first, last = sorted((choices.below(len(content)), choices.below(len(content))))
            return content[:first] + content[first:last] * choices.count(0, 3) + content[last:]
        case _:
            return _flipped(content, choices)


def _flipped(content: bytes, choices: Choices) -> bytes:
    changed = bytearray(content)
    for _ in range(choices.count(1, 6)):
        changed[choices.below(len(changed))] = choices.below(256)
    return bytes(changed)
