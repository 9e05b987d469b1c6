"""Problems of many solves with their tables, by what is special about them."""

from __future__ import annotations

import numpy as np

RANGES = """
(problem tags
  (data receivers external :key receiver)
  (data ranges external :with (receivers receiver))
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]) {more})
  (observe ranges {when} (= range (distance p [receivers.x receivers.y receivers.z])) :sigma {sigma})
  (derive (height (- {top} (p 3)) :unit cm) (far (distance p [0m 0m 0m])))
  (for-each epoch))
"""
CURVE = """
(problem curves
  (data d external)
  (unknowns (a {a}) (turn (rotation 3) :init [0.2 0.1 -0.3]) (t angle :init 0.3))
  (observe d (= [u v w] (+ (rotate turn [x y 1]) [a a 0])) :sigma 0.01)
  (observe d (= c (cos (+ t x))) :sigma 0.02)
  (for-each g k))
"""


def epochs(count=40, outliers=False, seed=5):
    """Ranges to eight receivers from places in a room; some epochs have fewer."""
    generator = np.random.default_rng(seed)
    at = np.column_stack([generator.uniform(0, 4, 8), generator.uniform(0, 4, 8), generator.uniform(2, 3, 8)])
    rows = [(e, r) for e in range(count) for r in range(8) if not (e % 7 == 3 and r > 4)]
    places = generator.uniform([0.5, 0.5, 0.3], [3, 3, 1.5], (count, 3))
    epoch, receiver = (np.array(column) for column in zip(*rows, strict=True))
    ranges = np.linalg.norm(places[epoch] - at[receiver], axis=1) + 0.01 * generator.standard_normal(len(rows))
    if outliers:
        ranges[::37] += 0.5
    mixed = generator.permutation(len(rows))
    return {
        "receivers": {"receiver": np.arange(8), "x": at[:, 0], "y": at[:, 1], "z": at[:, 2]},
        "ranges": {"epoch": epoch[mixed], "receiver": receiver[mixed], "range": ranges[mixed]},
    }


def track(count=40, seed=8, outliers=False):
    """Two tags that move a millimetre an epoch; some epochs have few ranges, and the rows are in no order."""
    generator = np.random.default_rng(seed)
    tables = epochs(1)
    at = np.column_stack([tables["receivers"][name] for name in "xyz"])
    rows = [(t, tag, r) for t in range(count) for tag in range(2) for r in range(8) if not (t % 9 == 4 and r > 1)]
    time, tag, receiver = (np.array(column) for column in zip(*rows, strict=True))
    places = np.array([[1.0, 2.0, 0.9], [3.0, 1.0, 1.3]])[tag] + 0.001 * time[:, None]
    ranges = np.linalg.norm(places - at[receiver], axis=1) + 0.01 * generator.standard_normal(len(rows))
    if outliers:
        ranges[::23] += 0.5
    mixed = generator.permutation(len(rows))
    return {
        "receivers": tables["receivers"],
        "ranges": {"epoch": 0.1 * time[mixed], "tag": tag[mixed], "receiver": receiver[mixed], "range": ranges[mixed]},
    }


def drifting(count=40, seed=9):
    """Sines whose frequency grows, from where the start leads to it to where only the window before does."""
    generator = np.random.default_rng(seed)
    time, x = np.repeat(np.arange(count), 20), np.tile(np.linspace(0, 10, 20), count)
    y = np.sin((1 + 0.03 * time) * x) + 0.05 * generator.standard_normal(len(x))
    return {"d": {"time": time, "x": x, "y": y}}


def images(count=12, seed=4, outliers=False):
    """A few points before a camera, seen from other places in each epoch."""
    from scipy.spatial.transform import Rotation

    generator = np.random.default_rng(seed)
    points = generator.uniform([-1, -1, 3], [1, 1, 6], (9, 3))
    parts = []
    for epoch in range(count):
        turn = Rotation.from_rotvec(generator.uniform(-0.4, 0.4, 3)).as_matrix()
        seen = points @ turn.T + generator.uniform(-0.5, 0.5, 3)
        image = 500 * seen[:, :2] / seen[:, 2:] + generator.standard_normal((9, 2))
        if outliers:
            image[epoch % 9] += 40.0
        parts += [(epoch, *points[i], *image[i]) for i in range(9)]
    return {"d": {name: [part[i] for part in parts] for i, name in enumerate(("epoch", "x", "y", "z", "u", "v"))}}


def turned_points(seed=2):
    """Points that are turned and shifted, in twelve groups under two keys, one of them a text."""
    from scipy.spatial.transform import Rotation

    generator = np.random.default_rng(seed)
    parts = []
    for g in range(6):
        for k in ("left", "right"):
            turn = Rotation.from_rotvec([0.25, 0.05 + 0.02 * g, -0.3]).as_matrix()
            xy = generator.uniform(-1, 1, (9, 2))
            uvw = np.column_stack([xy, np.ones(9)]) @ turn.T + [0.3, 0.3, 0.0]
            uvw += 0.01 * generator.standard_normal(uvw.shape)
            c = np.cos(0.4 + xy[:, 0]) + 0.02 * generator.standard_normal(9)
            parts += [(float(g), k, *xy[i], *uvw[i], c[i]) for i in range(9)]
    names = ("g", "k", "x", "y", "u", "v", "w", "c")
    return {"d": {name: [part[i] for part in parts] for i, name in enumerate(names)}}


HEIGHTS = "(data heights external) (unknowns"
BOTH = (
    RANGES.format(more="{more}", when="", sigma="{sigma}", top="2.7m")
    .replace("(unknowns", HEIGHTS)
    .replace("(for-each epoch)", "(observe heights (= h (p 3)) :sigma {second}) {solve} (for-each epoch)")
)


def both(outliers=False):
    """Ranges, and heights of the same epochs, one in ten of which is wrong."""
    tables = epochs(outliers=outliers)
    generator = np.random.default_rng(6)
    places = np.random.default_rng(5)
    places.uniform(0, 4, 16), places.uniform(2, 3, 8)  # what `epochs` draws before its places
    heights = np.repeat(places.uniform([0.5, 0.5, 0.3], [3, 3, 1.5], (40, 3))[:, 2], 4)
    heights = heights + 0.02 * generator.standard_normal(160)
    if outliers:
        heights[::10] += 0.4
    return {**tables, "heights": {"epoch": np.repeat(np.arange(40), 4), "h": heights}}


CONSENSUS = RANGES.format(more="", when="", sigma="10mm", top="2.7m").replace(
    "(for-each epoch)", "(for-each epoch) (solve :robust lmeds)"
)
WINDOWS = RANGES.format(more="", when="", sigma="{sigma}", top="2.7m").replace("(for-each epoch)", "{each}")
SLID = "(for-each tag) (window epoch :length {length} :step {step} :min-rows {least})"
STARTLESS = RANGES.format(more="", when="", sigma="{sigma}", top="2.7m").replace(":init [1.75m 1.75m 1m]", ":unit m")
IMAGES = """
(problem images
  (data d external)
  (unknowns (T (pose 3)))
  (camera cam :model pinhole :focal 500 :center (0 0) :axes opencv)
  (observe d (= [u v] (project cam (transform T [x y z]))) :sigma 1)
  (for-each epoch))
"""
LOSS = RANGES.format(more="", when="", sigma="10mm :loss huber", top="2.7m")
PROBLEMS = {
    "ranges": (RANGES.format(more="", when="", sigma="10mm", top="2.7m"), epochs()),
    "unknown noise": (RANGES.format(more="", when="", sigma="unknown", top="2.7m"), epochs()),
    "fixed": (RANGES.format(more="(b :init 2.7m :fixed true)", when="", sigma="10mm", top="b"), epochs()),
    "filtered": (RANGES.format(more="", when=":when (< receiver 7)", sigma="10mm", top="2.7m"), epochs()),
    "prior": (RANGES.format(more="(h :init 0.9m :sigma 3cm)", when="", sigma="10mm", top="h"), epochs()),
    "priors of rows": (
        RANGES.format(more="", when="", sigma="10mm", top="2.7m").replace(
            "(for-each", "(constraints (normal (p 3) 1m 30cm :over ranges)) (for-each"
        ),
        epochs(),
    ),
    "gross errors": (RANGES.format(more="", when="", sigma="10mm", top="2.7m"), epochs(outliers=True)),
    "a loss": (LOSS, epochs(outliers=True)),
    "a loss that is wide": (LOSS.replace("huber", "(huber 5)"), epochs()),
    "a loss of vectors": (
        "(problem turned (data d external) (unknowns (a :init 0) (turn (rotation 3) :init [0.2 0.1 -0.3]))"
        " (observe d (= [u v w] (+ (rotate turn [x y 1]) [a a 0])) :sigma 0.004 :loss soft-l1) (for-each g k))",
        turned_points(),
    ),
    "two kinds of rows": (BOTH.format(more="", sigma="10mm", second="2cm", solve=""), both()),
    "two unknown noises": (BOTH.format(more="", sigma="unknown", second="unknown", solve=""), both()),
    "two unknown noises without a start": (
        BOTH.format(more="", sigma="unknown", second="unknown", solve="").replace(":init [1.75m 1.75m 1m]", ":unit m"),
        both(),
    ),
    "a named unknown noise": (BOTH.format(more="", sigma="(unknown 1 :as receivers)", second="2cm", solve=""), both()),
    "one unknown noise of two": (BOTH.format(more="", sigma="unknown", second="2cm", solve=""), both()),
    "unknown noise and a prior": (
        RANGES.format(more="(h :init 0.9m :sigma 3cm)", when="", sigma="unknown", top="h").replace(
            "(= range (distance p [receivers.x receivers.y receivers.z]))",
            "(= range (distance [(p 1) (p 2) (- (p 3) (- h 0.9m))] [receivers.x receivers.y receivers.z]))",
        ),
        epochs(),
    ),
    "linear, two unknown noises": (
        "(problem lines (data d external) (unknowns (a :init 0) (b :init 0)) (observe d (= c (+ a (* b x))))"
        " (observe d (= u (- (* 2 b) (* 0.1 a)))) (for-each g k))",
        turned_points(),
    ),
    "a loss of unknown noise": (LOSS.replace("10mm", "unknown"), epochs(outliers=True)),
    "a loss of unknown noise that is not convex": (
        LOSS.replace("10mm :loss huber", "unknown :loss cauchy"),
        epochs(outliers=True),
    ),
    "a loss beside others": (
        BOTH.format(more="", sigma="10mm :loss huber", second="2cm", solve=""),
        both(outliers=True),
    ),
    "two losses": (
        BOTH.format(more="", sigma="10mm :loss huber", second="2cm :loss soft-l1", solve=""),
        both(outliers=True),
    ),
    "a loss that is not convex": (LOSS.replace("huber", "cauchy"), epochs(outliers=True)),
    "a loss of unknown noise beside others": (
        BOTH.format(more="", sigma="unknown :loss huber", second="2cm", solve=""),
        both(outliers=True),
    ),
    "a loss of unknown noise that is not convex beside others": (
        BOTH.format(more="", sigma="unknown :loss cauchy", second="2cm", solve=""),
        both(outliers=True),
    ),
    "a loss of unknown noise and a prior": (
        LOSS.replace("10mm", "unknown")
        .replace(":init [1.75m 1.75m 1m])", ":init [1.75m 1.75m 1m]) (b :init 0m :sigma 2mm)")
        .replace("(= range (distance", "(= (- range b) (distance"),
        epochs(outliers=True),
    ),
    "two losses of unknown noise": (
        BOTH.format(more="", sigma="unknown :loss huber", second="unknown :loss soft-l1", solve=""),
        both(outliers=True),
    ),
    "losses of noise known and unknown": (
        BOTH.format(more="", sigma="unknown :loss huber", second="2cm :loss huber", solve=""),
        both(outliers=True),
    ),
    "losses of unknown noise and a prior": (
        BOTH.format(
            more="(b :init 0m :sigma 2mm)", sigma="unknown :loss tukey", second="unknown :loss cauchy", solve=""
        ).replace("(= range (distance", "(= (- range b) (distance"),
        both(outliers=True),
    ),
    "a loss beside unknown noise": (
        BOTH.format(more="", sigma="10mm :loss huber", second="unknown", solve=""),
        both(outliers=True),
    ),
    "a loss that is not convex beside unknown noise": (
        BOTH.format(more="", sigma="10mm :loss cauchy", second="unknown", solve=""),
        both(outliers=True),
    ),
    "a loss of unknown noise beside unknown noise": (
        BOTH.format(more="", sigma="unknown :loss huber", second="unknown", solve=""),
        both(outliers=True),
    ),
    "a loss of unknown noise beside others without a start": (
        BOTH.format(more="", sigma="unknown :loss huber", second="2cm", solve="").replace(
            ":init [1.75m 1.75m 1m]", ":unit m"
        ),
        both(outliers=True),
    ),
    "windows of two unknown noises": (
        BOTH.format(more="", sigma="unknown", second="unknown", solve="").replace(
            "(for-each epoch)", "(window epoch :length 3 :step 1)"
        ),
        both(),
    ),
    "windows of a loss of unknown noise": (
        WINDOWS.format(sigma="unknown :loss huber", each=SLID.format(length=0.3, step=0.2, least=3)),
        track(outliers=True),
    ),
    "windows of a loss of unknown noise and a prior": (
        WINDOWS.format(sigma="unknown :loss huber", each=SLID.format(length=0.3, step=0.2, least=3))
        .replace(":init [1.75m 1.75m 1m])", ":init [1.75m 1.75m 1m]) (b :init 0m :sigma 2mm)")
        .replace("(= range (distance", "(= (- range b) (distance"),
        track(outliers=True),
    ),
    "two losses that are not convex": (
        BOTH.format(more="", sigma="10mm :loss tukey", second="2cm :loss cauchy", solve=""),
        both(outliers=True),
    ),
    "consensus of two kinds": (
        BOTH.format(more="", sigma="10mm", second="2cm", solve="(solve :robust msac)"),
        both(outliers=True),
    ),
    "consensus with a prior": (
        CONSENSUS.replace(":init [1.75m 1.75m 1m])", ":init [1.75m 1.75m 1m]) (b :init 0m :sigma 2mm)").replace(
            "(= range (distance", "(= (- range b) (distance"
        ),
        epochs(outliers=True),
    ),
    "consensus of unknown noise": (CONSENSUS.replace("10mm", "unknown"), epochs(outliers=True)),
    "consensus of two unknown noises": (
        BOTH.format(more="", sigma="unknown", second="unknown", solve="(solve :robust lmeds)"),
        both(outliers=True),
    ),
    "consensus of one unknown noise of two": (
        BOTH.format(more="", sigma="10mm", second="unknown", solve="(solve :robust msac)"),
        both(outliers=True),
    ),
    "consensus of unknown noise with a prior": (
        CONSENSUS.replace("10mm", "unknown")
        .replace(":init [1.75m 1.75m 1m])", ":init [1.75m 1.75m 1m]) (b :init 0m :sigma 2mm)")
        .replace("(= range (distance", "(= (- range b) (distance"),
        epochs(outliers=True),
    ),
    "windows of consensus of two unknown noises": (
        BOTH.format(more="", sigma="unknown", second="unknown", solve="(solve :robust lmeds)").replace(
            "(for-each epoch)", "(window epoch :length 3 :step 1)"
        ),
        both(outliers=True),
    ),
    "consensus of images": (
        IMAGES.replace("(for-each epoch)", "(solve :robust lmeds) (for-each epoch)"),
        images(outliers=True),
    ),
    "consensus": (CONSENSUS, epochs(outliers=True)),
    "consensus without a start": (CONSENSUS.replace(":init [1.75m 1.75m 1m]", ":unit m"), epochs(outliers=True)),
    "too few": (RANGES.format(more="", when=":when (< receiver 3)", sigma="10mm", top="2.7m"), epochs()),
    "windows": (WINDOWS.format(sigma="10mm", each=SLID.format(length=0.25, step=0.1, least=3)), track()),
    "windows with few rows": (WINDOWS.format(sigma="10mm", each=SLID.format(length=0.1, step=0.1, least=3)), track()),
    "windows of unknown noise": (
        WINDOWS.format(sigma="unknown", each=SLID.format(length=0.3, step=0.2, least=3)),
        track(),
    ),
    "windows without a start": (
        STARTLESS.format(sigma="10mm").replace("(for-each epoch)", SLID.format(length=0.3, step=0.2, least=3)),
        track(),
    ),
    "windows that do not fit": (
        WINDOWS.format(sigma="1mm", each=SLID.format(length=0.2, step=0.1, least=3)),
        track(),
    ),
    "windows of a loss": (
        WINDOWS.format(sigma="10mm :loss huber", each=SLID.format(length=0.3, step=0.2, least=3)),
        track(),
    ),
    "windows of a loss that is not convex": (
        WINDOWS.format(sigma="10mm :loss cauchy", each=SLID.format(length=0.3, step=0.2, least=3)),
        track(outliers=True),
    ),
    "windows of consensus": (
        WINDOWS.format(sigma="10mm", each="(solve :robust lmeds) " + SLID.format(length=0.3, step=0.2, least=3)),
        track(outliers=True),
    ),
    "windows of consensus without a start": (
        STARTLESS.format(sigma="10mm").replace(
            "(for-each epoch)", "(solve :robust lmeds) " + SLID.format(length=0.3, step=0.2, least=3)
        ),
        track(outliers=True),
    ),
    "windows with several minima": (
        "(problem sines (data d external) (unknowns (w :init 1)) (observe d (= y (sin (* w x))) :sigma 0.05)"
        " (window time :length 1 :step 1))",
        drifting(),
    ),
    "without a start": (STARTLESS.format(sigma="10mm"), epochs()),
    "without a start, unknown noise": (STARTLESS.format(sigma="unknown"), epochs()),
    "without a start, a loss": (STARTLESS.format(sigma="10mm :loss huber"), epochs(outliers=True)),
    "poses without a start": (IMAGES, images()),
    "lines without a start": (
        "(problem lines (data d external) (unknowns (a) (b))"
        " (observe d (= c (+ a (* b x))) :sigma 0.1) (for-each g k))",
        turned_points(),
    ),
    "rotations": (CURVE.format(a=":init 0"), turned_points()),
    "scattered": (
        "(problem lines (data d external) (unknowns (a :init 0) (b :init 0))"
        " (observe d (= c (+ a (* b x))) :sigma unknown) (derive (twice (* 2 a))) (for-each g k))",
        turned_points(),
    ),
    "bounds": (CURVE.format(a=":init 0 :in (-1 0.3)"), turned_points()),
    "linear": (
        "(problem lines (data d external) (unknowns (a :init 0) (b :init 0))"
        " (observe d (= c (+ a (* b x))) :sigma (+ 0.01 (abs y))) (for-each g k))",
        turned_points(),
    ),
}
