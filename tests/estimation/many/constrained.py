"""Problems of many solves with constraints, by what is special about them, with their tables."""

from __future__ import annotations

import numpy as np

from tests.estimation.many.problems import BOTH, CURVE, LOSS, RANGES, SLID, STARTLESS, both, epochs, turned_points


def held(text, constraints):
    """A problem with constraints."""
    return text.replace("(for-each", f"(constraints {constraints}) (for-each", 1)


def ring(times=12, tags=1, seed=11, outliers=False):
    """Ranges from places on a circle of 1 m about (2, 2), up to a height of 1 m; some times have fewer."""
    generator = np.random.default_rng(seed)
    receivers = epochs(1)["receivers"]
    at = np.column_stack([receivers[name] for name in "xyz"])
    rows = [(t, tag, r) for t in range(times) for tag in range(tags) for r in range(8) if not (t % 7 == 3 and r > 4)]
    time, tag, receiver = (np.array(column) for column in zip(*rows, strict=True))
    angle, height = 0.01 * time + tag, 0.95 + 0.05 * np.cos(0.2 * time)
    places = np.column_stack([2 + np.cos(angle), 2 + np.sin(angle), height])
    ranges = np.linalg.norm(places - at[receiver], axis=1) + 0.01 * generator.standard_normal(len(rows))
    if outliers:
        ranges[::23] += 0.3
    mixed = generator.permutation(len(rows))
    columns = {"epoch": 0.1 * time, "tag": tag, "receiver": receiver, "range": ranges}
    return {"receivers": receivers, "ranges": {name: column[mixed] for name, column in columns.items()}}


def lines(groups=18, rows=12, seed=12):
    """Planes ``0.5 + b x + e y`` with a slope b that grows from group to group, and the slope e = 0.5 - b."""
    generator = np.random.default_rng(seed)
    group = np.repeat(np.arange(groups), rows)
    x, y = generator.uniform(-1, 1, (2, len(group)))
    slope = group / groups
    z = 0.5 + slope * x + (0.5 - slope) * y + 0.1 * generator.standard_normal(len(group))
    return {"d": {"g": group, "x": x, "y": y, "z": z}}


PLANES = """
(problem planes
  (data d external)
  (unknowns (a {start}) (b {start}) (e {start}))
  (observe d (= z (+ a (* b x) (* e y))) :sigma {sigma})
  (constraints {constraints})
  (derive (both (+ b e)) (share (/ a 2)))
  (for-each g))
"""
AFFINE = "(= (+ b e) 0.5 :name total) (<= b 0.5 :name most) (>= a 0.45 :name least)"
CIRCLE = "(= (distance [(p 1) (p 2)] [2m 2m]) 1m :name circle)"
SHELF = "(<= (p 3) 98cm :name shelf)"
NEAR = RANGES.replace("[1.75m 1.75m 1m]", "[2.5m 2.5m 1m]")
EPOCHS = NEAR.format(more="", when="", sigma="10mm", top="2.7m")
UNKNOWN = NEAR.format(more="", when="", sigma="unknown", top="2.7m")
LONG = SLID.format(length=0.35, step=0.1, least=4)
SLIDING = EPOCHS.replace("(for-each epoch)", LONG)
PROBLEMS = {
    "an equation": (held(EPOCHS, CIRCLE), ring()),
    "an equation, unknown noise": (held(UNKNOWN, CIRCLE), ring()),
    "an inequality": (held(EPOCHS, SHELF), ring()),
    "an inequality, unknown noise": (held(UNKNOWN, SHELF), ring()),
    "both": (held(EPOCHS, f"{CIRCLE} {SHELF}"), ring()),
    "both, unknown noise": (held(UNKNOWN, f"{CIRCLE} {SHELF}"), ring()),
    "said twice": (held(EPOCHS, f"{CIRCLE} (= (distance [2m 2m] [(p 1) (p 2)]) 100cm) {SHELF}"), ring()),
    "affine": (PLANES.format(start=":init 0", sigma="0.1", constraints=AFFINE), lines()),
    "affine, unknown noise": (PLANES.format(start=":init 0", sigma="unknown", constraints=AFFINE), lines()),
    "affine without a start": (PLANES.format(start="", sigma="0.1", constraints=AFFINE), lines()),
    "of rows": (
        held(EPOCHS, "(<= (distance p [receivers.x receivers.y receivers.z]) (+ range 2cm) :over ranges :name reach)"),
        ring(20, seed=16),  # some of whose times are pushed
    ),
    "an unknown that an equation alone determines": (
        held(NEAR.format(more="(h :init 1m)", when="", sigma="10mm", top="h"), "(= h (* 2 (p 3)))"),
        ring(),
    ),
    "a prior": (
        held(NEAR.format(more="(h :init 0.95m :sigma 3cm)", when="", sigma="10mm", top="h"), "(<= (p 3) h)"),
        ring(),
    ),
    "a loss": (held(LOSS.replace("[1.75m 1.75m 1m]", "[2.5m 2.5m 1m]"), f"{CIRCLE} {SHELF}"), ring(outliers=True)),
    "rotations": (held(CURVE.format(a=":init 0"), "(<= t 0.4) (= a 0.3)"), turned_points()),
    "bounds": (held(CURVE.format(a=":init 0 :in (-1 0.3)"), "(<= t 0.4)"), turned_points()),
    "windows": (held(SLIDING, f"{CIRCLE} {SHELF}"), ring(tags=2)),
    "windows of unknown noise": (
        held(UNKNOWN.replace("(for-each epoch)", LONG), f"{CIRCLE} {SHELF}"),
        ring(tags=2),
    ),
    "everything held": (held(EPOCHS, "(= (p 1) 1m) (= (p 2) 2m) (= (p 3) 1m)"), epochs(12)),
    "far from the data": (held(EPOCHS, "(= (distance p [0m 0m 0m]) 2.5m)"), epochs(12)),
    "a contradiction": (held(EPOCHS, "(>= (p 1) 1m) (<= (p 1) 0.9m)"), ring()),
    "two unknown noises": (
        held(BOTH.format(more="", sigma="unknown", second="unknown", solve=""), "(<= (p 3) 1.2m)"),
        both(),
    ),
    "without a start": (held(STARTLESS.format(sigma="10mm"), SHELF), ring()),
    "exact": (held(EPOCHS, f"{CIRCLE} {SHELF}").replace("(for-each", "(solve :constraints exact) (for-each"), ring()),
    "a loss that is not convex": (held(LOSS.replace("huber", "cauchy"), SHELF), ring(outliers=True)),
    "consensus": (held(EPOCHS.replace("(for-each", "(solve :robust lmeds) (for-each"), SHELF), ring(outliers=True)),
}
