"""Plaza 1 (Djugash, CMU): a lawn mower with range radios and GPS truth, as tables; and its problem files.

The .mat file holds GT (t, x, y, heading), TD (t, sender, node, range) and TL (node, x, y) in s, m, rad.
"""

from __future__ import annotations

import numpy as np

from tests.evidence.material import measured

CALIBRATION = """
;; What is wrong with each radio: the mower's true places are known, scale and offset of every node are not.
(problem calibration
  (data nodes (csv "nodes.csv") :key node :columns ((x x :unit m) (y y :unit m)))
  (data ranges (csv "ranges.csv") :with (nodes node)
    :columns ((t t :unit s) (x x :unit m) (y y :unit m) (range range :unit m)))
  (unknowns
    (gain :per nodes :init 1)
    (offset :per nodes :init 0m))
  (define (true-range (distance [x y] [nodes.x nodes.y])))
  (observe ranges (= range (+ (* (gain node) true-range) (offset node)))))
"""
RAW = """
;; The ranges as they come, against the true places: one offset for all, held at zero by its prior.
(problem raw
  (data nodes (csv "nodes.csv") :key node)
  (data ranges (csv "ranges.csv") :with (nodes node))
  (unknowns (offset :init 0m :sigma 1um))
  (observe ranges (= range (+ (distance [x y] [nodes.x nodes.y]) offset)) :sigma 1m))
"""
POSITIONS = """
;; Where the mower was: each few seconds stand alone, a place and a velocity from some ten ranges.
(problem positions
  (data nodes (csv "nodes.csv") :key node :columns ((x x :unit m) (y y :unit m) (offset offset :unit m)))
  (data ranges (csv "ranges.csv") :with (nodes node) :columns ((t t :unit s) (range range :unit m)))
  (unknowns
    (p (vector 2) :init [-5m 20m])
    (v (vector 2) :init [0m/s 0m/s] :sigma 0.5m/s))
  (observe ranges
    (= range (+ (* nodes.gain (distance (+ p (* t v)) [nodes.x nodes.y])) nodes.offset))
    :sigma 0.55m)
  (for-each window))
"""
WINDOW = 4.0
"""Seconds that are solved together; the mower goes at up to 1.5 m/s."""


def recorded() -> dict[str, np.ndarray]:
    """The arrays of the file, times from the first range."""
    import scipy.io

    found = scipy.io.loadmat(str(measured("plaza", "Plaza1_.mat")))
    truth, ranges = found["GT"].copy(), found["TD"].copy()
    ranges = ranges[np.argsort(ranges[:, 0], kind="stable")]
    origin = ranges[0, 0]
    truth[:, 0] -= origin
    ranges[:, 0] -= origin
    return {"truth": truth, "ranges": ranges, "nodes": found["TL"]}


def true_places(truth: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The GPS places (len(times), 2), linear between fixes 0.2 s apart."""
    return np.column_stack([np.interp(times, truth[:, 0], truth[:, k]) for k in (1, 2)])


def node_table(nodes: np.ndarray) -> dict[str, list[object]]:
    return {"node": nodes[:, 0].astype(int).tolist(), "x": nodes[:, 1].tolist(), "y": nodes[:, 2].tolist()}


def calibration_tables(data: dict[str, np.ndarray]) -> dict[str, dict[str, list[object]]]:
    """Each range with the place where it was measured."""
    times, nodes, ranges = data["ranges"][:, 0], data["ranges"][:, 2], data["ranges"][:, 3]
    places = true_places(data["truth"], times)
    table = {"t": times, "node": nodes.astype(int), "x": places[:, 0], "y": places[:, 1], "range": ranges}
    return {"nodes": node_table(data["nodes"]), "ranges": {k: v.tolist() for k, v in table.items()}}


def window_tables(
    data: dict[str, np.ndarray], gain: dict[float, float], offset: dict[float, float], most: int | None = None
) -> tuple[dict[str, dict[str, list[object]]], np.ndarray]:
    """Ranges by window, ``most`` of them, times from its middle; and the true places at the middles (windows, 2).

    Windows with fewer than 6 ranges or 3 nodes are left out: they have too little for a place and a velocity.
    """
    times, nodes, ranges = data["ranges"][:, 0], data["ranges"][:, 2], data["ranges"][:, 3]
    window = (times // WINDOW).astype(int)
    kept = [w for w in np.unique(window) if (window == w).sum() >= 6 and len(np.unique(nodes[window == w])) >= 3]
    kept = kept[:most]
    rows = np.isin(window, kept)
    middle = (window + 0.5) * WINDOW
    table = {"window": window, "t": times - middle, "node": nodes.astype(int), "range": ranges}
    keys = data["nodes"][:, 0]
    radios = {**node_table(data["nodes"]), "gain": [gain[k] for k in keys], "offset": [offset[k] for k in keys]}
    places = true_places(data["truth"], (np.array(kept) + 0.5) * WINDOW)
    return {"nodes": radios, "ranges": {k: v[rows].tolist() for k, v in table.items()}}, places
