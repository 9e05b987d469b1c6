"""Meshes from files: numbers as in the file, edges where faces meet at an angle, and what is wrong with files."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import mbm
from mbm.shapes.meshes import obj, ply, stl
from mbm.shapes.meshes.form import edges
from mbm.shapes.meshes.types import MOST, DamagedMeshError
from mbm.text.types import MbmError

CORNERS = np.array([(x, y, z) for z in (0.25, -0.25) for x, y in ((1, 0.5), (-1, 0.5), (-1, -0.5), (1, -0.5))])
"""Of a box 2 × 1 × 0.5: exact in single precision."""
SIDES = [(0, 1, 2, 3), (7, 6, 5, 4), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)]
TRIANGLES = [t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))]
BOX_EDGES = sorted({(min(e), max(e)) for s in SIDES for e in zip(s, (*s[1:], s[0]), strict=True)})


def written_obj(corners=CORNERS, faces=SIDES) -> bytes:
    lines = ["mtllib wood.mtl", "o box", "vt 0 0", "usemtl wood"]
    lines += [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in corners]
    lines += ["f " + " ".join(f"{c + 1}/1/{c + 1}" for c in face) + " # a side" for face in faces]
    return "\n".join(lines).encode()


def written_stl(corners=CORNERS, faces=TRIANGLES) -> bytes:
    lines = ["solid box"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(f"{c:.17g}" for c in corners[i]) for i in face]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid box"]).encode()


def binary_stl(corners=CORNERS, faces=TRIANGLES, count=None, header=b"solid but binary") -> bytes:
    content = header.ljust(80, b" ") + struct.pack("<I", len(faces) if count is None else count)
    return content + b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(corners[list(f)]), 7) for f in faces)


def written_ply(order="ascii", corners=CORNERS, faces=SIDES, count=None) -> bytes:
    header = (
        f"ply\nformat {order} 1.0\ncomment by hand\nelement vertex {len(corners) if count is None else count}\n"
        "property float x\nproperty float y\nproperty uchar red\nproperty double z\n"
        "element edge 1\nproperty int vertex1\nproperty int vertex2\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nproperty uchar flag\nend_header\n"
    ).encode()
    if order == "ascii":
        rows = [f"{x:.17g} {y:.17g} 200 {z:.17g}" for x, y, z in corners] + ["0 1"]
        rows += [f"{len(f)} {' '.join(map(str, f))} 1" for f in faces]
        return header + "\n".join(rows).encode() + b"\n"
    sign = "<" if "little" in order else ">"
    body = b"".join(struct.pack(sign + "ffBd", x, y, 200, z) for x, y, z in corners) + struct.pack(sign + "ii", 0, 1)
    return header + body + b"".join(struct.pack(f"{sign}B{len(f)}iB", len(f), *f, 1) for f in faces)


FORMATS = {
    "obj": (obj.read, written_obj(), SIDES),
    "ply": (ply.read, written_ply(), SIDES),
    "ply little": (ply.read, written_ply("binary_little_endian"), SIDES),
    "ply big": (ply.read, written_ply("binary_big_endian"), SIDES),
    "stl": (stl.read, written_stl(), TRIANGLES),
    "stl binary": (stl.read, binary_stl(), TRIANGLES),
}


@pytest.mark.parametrize("name", FORMATS)
def test_numbers_are_those_of_the_file(name):
    """The box has its corners in the order in which its triangles first name them: one order for all formats."""
    read, content, faces = FORMATS[name]
    mesh = read(content)
    if name.startswith("stl"):
        first = list(dict.fromkeys(corner for face in TRIANGLES for corner in face))
        np.testing.assert_array_equal(mesh.vertices, CORNERS[first])
        faces = [tuple(first.index(corner) for corner in face) for face in faces]
    else:
        np.testing.assert_array_equal(mesh.vertices, CORNERS)
    assert list(mesh.faces) == list(faces)


@pytest.mark.parametrize("name", FORMATS)
def test_lines_are_the_edges_of_the_box(name):
    """Not the diagonals of its sides, where two triangles are one plane."""
    read, content, _ = FORMATS[name]
    mesh = read(content)
    lengths = sorted(np.linalg.norm(mesh.vertices[a] - mesh.vertices[b]) for a, b in edges(mesh))
    np.testing.assert_array_equal(lengths, [0.5] * 4 + [1] * 4 + [2] * 4)
    assert edges(mesh) == sorted(edges(mesh))
    if not name.startswith("stl"):
        assert edges(mesh) == BOX_EDGES


@pytest.mark.parametrize(("angle", "count"), [(0.9, 0), (1.1, 1), (90, 1), (179, 1)])
def test_an_edge_is_where_faces_meet_at_more_than_a_degree(angle, count):
    bend = np.deg2rad(angle)
    corners = [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (np.cos(bend), 0, np.sin(bend))]
    for faces in ([(0, 1, 2), (1, 0, 3)], [(0, 1, 2), (0, 1, 3)]):  # the other way round, it is the same surface
        assert len(edges(obj.read(written_obj(corners, faces)))) == count


def test_corners_of_an_obj_count_back_from_the_last_vertex_so_far():
    mesh = obj.read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf 1//1 2//1 -1//1\n")
    assert mesh.faces == ((0, 1, 2), (0, 1, 3))


PART = '(problem p (data d (table (n x y z) {rows})) (unknowns (t (vector 3) :init [0 0 0]))\n' \
    ' (observe d (= [x y z] (vertex (trans t (mesh "{path}"{option})) n)) :sigma 0.001))'  # fmt: skip


def problem(path: str, option: str = "", scale: float = 1.0) -> str:
    rows = " ".join(f"({i + 1} {' '.join(f'{scale * c + 0.1:.17g}' for c in p)})" for i, p in enumerate(CORNERS))
    return PART.format(rows=rows, path=path, option=option)


@pytest.mark.parametrize(("option", "scale"), [("", 1.0), (" :unit mm", 1e-3), (" :unit cm", 1e-2)])
def test_a_solve_with_a_mesh(tmp_path, option, scale):
    (tmp_path / "box.obj").write_bytes(written_obj())
    (tmp_path / "p.mbm").write_text(problem("box.obj", option, scale), "utf-8")
    found = mbm.load(tmp_path / "p.mbm").solve().first
    assert found.status == "converged"
    np.testing.assert_allclose(found.estimates[0].value, [0.1, 0.1, 0.1], atol=1e-12)


def test_features_of_a_mesh_in_a_model(tmp_path):
    (tmp_path / "box.ply").write_bytes(written_ply())
    text = (
        '(defmodel m (h) (lid (trans [0 0 h] (mesh "box.ply"))))\n(problem p (unknowns (h :init 0))'
        "(observe (= 0m (point-plane-distance [0 0 1m] (plane (m h) lid 1))) :sigma 1mm)"
        "(observe other (= 0m (point-line-distance [0 0.5m 1m] (line (m h) lid 1))) :sigma 1m))"
    )
    (tmp_path / "p.mbm").write_text(text, "utf-8")
    found = mbm.load(tmp_path / "p.mbm").solve().first
    assert float(found.estimates[0].value) == pytest.approx(0.75, abs=1e-6)


def test_a_mesh_that_changed_is_read_anew(tmp_path):
    """What was compiled before is not taken for another content of the file, and other problems do not hide it."""
    text = "(problem other (unknowns (a :init 0)) (observe (= 1 a) :sigma 1))\n" + problem("box.obj")
    (tmp_path / "p.mbm").write_text(text, "utf-8")
    for scale in (1.0, 1.0, 2.0):
        (tmp_path / "box.obj").write_bytes(written_obj(scale * CORNERS))
        assert mbm.load(tmp_path / "p.mbm").named("other").solve().first.status == "converged"
        found = mbm.load(tmp_path / "p.mbm").named("p").solve().first
        assert (found.cost < 1e-12) == (scale == 1.0)


def test_paths_are_relative_to_the_file_in_which_they_stand(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "box.stl").write_bytes(binary_stl())
    (tmp_path / "parts" / "part.mbm").write_text('(defmodel part () (mesh "box.stl"))', "utf-8")
    text = '(use "parts/part.mbm") (problem p (unknowns (h :init 0)) (observe (= h ((vertex (part) 1) 1)) :sigma 1m))'
    (tmp_path / "p.mbm").write_text(text, "utf-8")
    assert float(mbm.load(tmp_path / "p.mbm").solve().first.estimates[0].value) == pytest.approx(1.0)


def fault(folder: Path, path: str, **options):
    (folder / "p.mbm").write_text(problem(path), "utf-8")
    with pytest.raises(MbmError) as caught:
        mbm.load(folder / "p.mbm", **options).compile()
    return caught.value.diagnostics[0]


def test_the_sandbox_holds(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "box.obj").write_bytes(written_obj())
    (inner / "link.obj").symlink_to(tmp_path / "box.obj")
    for path in ("../box.obj", "link.obj", str(tmp_path / "box.obj")):
        assert fault(inner, path, sandbox=inner).code.name == "outside-sandbox"


def test_files_that_cannot_be_read(tmp_path):
    assert fault(tmp_path, "none.obj").code.name == "missing-file"
    (tmp_path / "folder.obj").mkdir()
    assert fault(tmp_path, "folder.obj").code.name == "not-a-file"
    os.mkfifo(tmp_path / "pipe.obj")
    assert fault(tmp_path, "pipe.obj").code.name == "not-a-file"
    with (tmp_path / "large.obj").open("wb") as stream:
        stream.truncate(60_000_000)
    assert fault(tmp_path, "large.obj").code.name == "file-too-large"
    (tmp_path / "box.step").write_bytes(b"ISO-10303-21;")
    found = fault(tmp_path, "box.step")
    assert found.code.name == "damaged-mesh"
    assert ".stl .obj .ply" in found.message


def test_materials_are_not_read(tmp_path):
    """A pipe of that name would wait for ever; a file of that name is not noted as read."""
    os.mkfifo(tmp_path / "wood.mtl")
    (tmp_path / "box.obj").write_bytes(written_obj())
    (tmp_path / "p.mbm").write_text(problem("box.obj"), "utf-8")
    assert mbm.load(tmp_path / "p.mbm").solve().first.status == "converged"


NAN = CORNERS.copy()
NAN[3, 1] = np.nan
DAMAGED = {
    "empty obj": (obj.read, b"", "no vertices"),
    "no vertices": (obj.read, b"f 1 2 3\n", "no vertices"),
    "vertex of two": (obj.read, b"v 1 2\n", "three coordinates"),
    "vertex of words": (obj.read, b"v 1 2 c\n", "three coordinates"),
    "number with underscore": (obj.read, b"v 1 2 1_0\n", "three coordinates"),
    "nan": (obj.read, b"v 1 2 nan\n", "vertex 1"),
    "overflow": (obj.read, b"v 1 2 1e999\n", "vertex 1"),
    "corner 0": (obj.read, b"v 1 2 3\nf 0 1 1\n", "`0` names no vertex"),
    "corner before": (obj.read, b"v 1 2 3\nf -2 1 1\n", "names no vertex"),
    "corner beyond": (obj.read, b"v 1 2 3\nf 1 1 9\n", "names vertex 9 of 1"),
    "long corner": (obj.read, b"v 1 2 3\nf 1 1 " + b"9" * 100_000, "names no vertex"),
    "two corners": (obj.read, b"v 1 2 3\nf 1 1\n", "2 corners"),
    "many corners": (obj.read, b"v 1 2 3\nf" + b" 1" * 2000, "1,000 corners"),
    "many vertices": (obj.read, b"v 1 2 3\n" * (MOST + 1), "100,000"),
    "line goes on": (obj.read, b"v 1 2 \\\n3\n", "go on"),
    "no text": (obj.read, b"v 1 2 3\n\xff\n", "0xff"),
    "empty stl": (stl.read, b"", "neither"),
    "no triangles": (stl.read, binary_stl(faces=[]), "no triangles"),
    "short": (stl.read, binary_stl()[:-1], "no text"),
    "short, no solid": (stl.read, binary_stl(header=b"x")[:-1], "its header counts 12"),
    "huge count": (stl.read, binary_stl(count=2**32 - 1, header=b"x"), "4,294,967,295"),
    "nan in stl": (stl.read, binary_stl(NAN), "no finite number"),
    "stl in a facet": (stl.read, written_stl()[:-30], "ends within"),
    "stl of two vertices": (stl.read, b"solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\nendfacet\n", "three"),
    "no header": (ply.read, b"play", "no header"),
    "no format": (ply.read, b"ply\nelement vertex 0\nproperty float x\nend_header\n", "format"),
    "strange line": (ply.read, b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "no line of a header"),
    "no properties": (ply.read, b"ply\nformat ascii 1.0\nelement vertex 9\nend_header\n", "no properties"),
    "count of ply": (ply.read, written_ply(count=99_999), "ends before"),
    "huge count of ply": (ply.read, written_ply(count=999_999_999), "100,000"),
    "huge count of binary ply": (ply.read, written_ply("binary_big_endian", count=99_999), "ends before"),
    "truncated ply": (ply.read, written_ply("binary_little_endian")[:-30], "ends before"),
    "ply of words": (ply.read, written_ply().replace(b"200", b"red"), "numbers are wanted"),
    "ply without z": (ply.read, written_ply().replace(b"double z", b"double w"), "no property `z`"),
    "ply without indices": (ply.read, written_ply().replace(b"vertex_indices", b"corners_of_it"), "vertex_indices"),
    "ply beyond": (ply.read, written_ply(faces=[(0, 1, 8)]), "names vertex 9 of 8"),
    "ply before": (ply.read, written_ply(faces=[(0, 1, -1)]), "names vertex 0 of 8"),
    "nan in ply": (ply.read, written_ply(corners=NAN), "vertex 4"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_files(name):
    read, content, words = DAMAGED[name]
    with pytest.raises(DamagedMeshError) as caught:
        read(content)
    assert words in caught.value.message


@settings(max_examples=150, deadline=None, derandomize=True)
@given(name=st.sampled_from(sorted(FORMATS)), at=st.floats(0, 1), part=st.binary(max_size=12), cut=st.booleans())
def test_whatever_is_changed_is_read_or_refused(name, at, part, cut):
    """Nothing else is raised; what is read has finite numbers and corners that are there."""
    read, content, _ = FORMATS[name]
    place = int(at * len(content))
    changed = content[:place] + part + (b"" if cut else content[place + len(part) :])
    try:
        mesh = read(changed)
    except DamagedMeshError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert all(0 <= corner < len(mesh.vertices) for face in mesh.faces for corner in face)
    edges(mesh)


def test_many_faces_at_one_edge_take_no_long_time():
    """They are looked at one by one, not two by two."""
    faces = b"f 1 2 3\n" + b"f 2 1 3\n" * 50_000
    assert edges(obj.read(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + faces)) == [(0, 1), (0, 2), (1, 2)]


def test_coordinates_near_the_largest_numbers():
    assert isinstance(edges(obj.read(written_obj(1e300 * CORNERS))), list)


USES = [
    ("bad-form", "(mesh box)", "takes the path"),
    ("bad-form", "(mesh)", "takes the path"),
    ("bad-form", '(mesh "box.obj" :scale 3)', "`:unit`"),
    ("bad-form", '(mesh "box.obj" :unit kg)', "unit of length"),
    ("bad-form", '(mesh "box.obj" :unit 3)', "unit of length"),
    ("unknown-feature", '(mesh "box.obj")', "9"),
]


@pytest.mark.parametrize(("code", "form", "words"), USES, ids=[u[1] for u in USES])
def test_uses(tmp_path, code, form, words):
    (tmp_path / "box.obj").write_bytes(written_obj())
    text = f"(problem p (unknowns (h :init 0)) (observe (= [h 0 0] (vertex {form} 9)) :sigma 1m))"
    (tmp_path / "p.mbm").write_text(text, "utf-8")
    with pytest.raises(MbmError) as caught:
        mbm.load(tmp_path / "p.mbm").compile()
    found = caught.value.diagnostics[0]
    assert found.code.name == code, found.message
    assert words in f"{found.message} | {found.hint}"
