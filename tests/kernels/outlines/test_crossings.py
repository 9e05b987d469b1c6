"""Where arcs cross: pieces of outlines keep their sense, also where three arcs all but meet in one point."""

from __future__ import annotations

import numpy as np

from mbm.expression.nodes import Figure
from mbm.kernels.outlines.outline import ArcTable, Outline, Spans, _crossed
from mbm.kernels.outlines.surveyor import Surveyor


def triangle(lines, first, last):
    """Pieces of straight lines (3, 2, 2), each followed by the next, with ends ``first`` and ``last`` as drafted."""
    images = np.concatenate(lines).astype(float)
    arcs = ArcTable(
        sheet=np.zeros(3, dtype=np.int64),
        fold=np.zeros(3, dtype=bool),
        straight=np.ones(3, dtype=bool),
        chords=np.ones(3, dtype=np.int64),
        begin=np.arange(0, 6, 2),
        nodes=np.tile([[0.0, 0.0], [1.0, 0.0]], (3, 1)),
        images=images,
        places=np.zeros((3, 1), dtype=np.int64),
        net=np.full(3, -1),
    )
    none = Spans(piece=np.zeros(0, dtype=np.int64), first=np.zeros(0), last=np.zeros(0))
    return Outline(
        surveyor=Surveyor(Figure(size=1, sheets=(), lines=(), faces=(), patches=(), ends=(), nets=()), (), dict),
        numbers=np.zeros(1),
        arcs=arcs,
        arc=np.arange(3),
        first=np.array(first, dtype=float),
        last=np.array(last, dtype=float),
        following=np.array([1, 2, 0]),
        spans=none,
    )


BASE, RISING = [(-1, 0), (3, 0)], [(2.5, -1), (0.5, 3)]


def test_pieces_end_where_lines_cross():
    """The base meets the rising line at (2, 0), this the falling one at (1, 2), and that the base at (0, 0)."""
    lines = np.array([BASE, RISING, [(1.5, 3), (-0.5, -1)]])
    found = _crossed(triangle(lines, first=[0.3, 0.3, 0.3], last=[0.7, 0.7, 0.7]))
    np.testing.assert_allclose(found.first, [0.25, 0.25, 0.25], atol=1e-12)
    np.testing.assert_allclose(found.last, [0.75, 0.75, 0.75], atol=1e-12)


def test_a_piece_is_not_turned_round():
    """The third line crosses the second one before the first line does: on such a piece nothing is moved."""
    lines = np.array([BASE, RISING, [(3.0, -0.8), (-1.0, -0.4)]])
    found = _crossed(triangle(lines, first=[0.3, 0.2, 0.3], last=[0.7, 0.22, 0.9]))
    assert (found.first <= found.last).all()
    assert (found.first[1], found.last[1]) == (0.2, 0.22)
