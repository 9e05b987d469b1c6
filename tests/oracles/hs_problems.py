"""Hock and Schittkowski's problems by number: formulas, starts, optima as printed."""

from __future__ import annotations

from math import sqrt

import numpy as np

from tests.oracles.hock_schittkowski import NONE, Published

BANANA = "10*(x2 - x1**2), 1 - x1"
FIVE = "x2 + x3 - 2, x4 - 1, x5 - 1"

HS57_A = np.repeat(np.arange(8, 44, 2), [2, 4, 4, 3, 3, 2, 3, 3, 3, 3, 2, 3, 2, 1, 2, 2, 1, 1])
HS57_B = """.49 .49 .48 .47 .48 .47 .46 .46 .45 .43 .45 .43 .43 .44 .43 .43 .46 .45 .42 .42 .43 .41 .41 .40 .42 .40
    .40 .41 .40 .41 .41 .40 .40 .40 .38 .41 .40 .40 .41 .38 .40 .40 .39 .39"""

LEFT = float(min(np.roots([400.0, 0.0, 2.0 - 600.0, -2.0])))
"""Of HS2 at its bound x2 = 1.5: the derivative's least root, on the other side of the ridge."""

PROBLEMS: dict[str, Published] = {
    "HS1": Published(residuals=BANANA, start=(-2, 1), lower=(-NONE, -1.5), minima=((0, (1, 1)),)),
    "HS2": Published(
        residuals=BANANA, start=(-2, 1), lower=(-NONE, 1.5),
        minima=((0.0504261879, (1.224370749, 1.5)), (100 * (1.5 - LEFT**2) ** 2 + (1 - LEFT) ** 2, (LEFT, 1.5))),
    ),
    "HS6": Published(residuals="1 - x1", start=(-1.2, 1), equal="10*(x2 - x1**2)", minima=((0, (1, 1)),)),
    "HS12": Published(
        residuals="sqrt(0.5)*(x1 - x2 - 7), sqrt(0.5)*(x2 - 14)", start=(0, 0), above="25 - 4*x1**2 - x2**2",
        minima=((-30 + 122.5, (2, 3)),),
    ),
    "HS14": Published(
        residuals="x1 - 2, x2 - 1", start=(2, 2), equal="x1 - 2*x2 + 1", above="1 - 0.25*x1**2 - x2**2",
        minima=((9 - 2.875 * sqrt(7), (0.5 * (sqrt(7) - 1), 0.25 * (sqrt(7) + 1))),),
    ),
    "HS15": Published(
        residuals=BANANA, start=(-2, 1), above="x1*x2 - 1, x1 + x2**2", upper=(0.5, NONE),
        minima=((306.5, (0.5, 2)), (360.379767, (-0.792123, -1.262432))),
    ),
    "HS16": Published(
        residuals=BANANA, start=(-2, 1), above="x1 + x2**2, x1**2 + x2", lower=(-0.5, -NONE), upper=(0.5, 1),
        minima=((0.25, (0.5, 0.25)), (100 * (sqrt(0.5) - 0.25) ** 2 + 2.25, (-0.5, sqrt(0.5)))),
    ),
    "HS17": Published(
        residuals=BANANA, start=(-2, 1), above="x2**2 - x1, x1**2 - x2", lower=(-0.5, -NONE), upper=(0.5, 1),
        minima=((1, (0, 0)),), flat=True,
    ),
    "HS18": Published(
        residuals="0.1*x1, x2", start=(2, 2), above="x1*x2 - 25, x1**2 + x2**2 - 25", lower=(2, 0), upper=(50, 50),
        minima=((5, (sqrt(250), sqrt(2.5))),),
    ),
    "HS20": Published(
        residuals=BANANA, start=(-2, 1), above="x1 + x2**2, x1**2 + x2, x1**2 + x2**2 - 1", lower=(-0.5, -NONE),
        upper=(0.5, NONE), minima=(
            (81.5 - 25 * sqrt(3), (0.5, 0.5 * sqrt(3))), (100 * (sqrt(0.75) - 0.25) ** 2 + 2.25, (-0.5, sqrt(0.75))),
        ),
    ),
    "HS21": Published(
        residuals="0.1*x1, x2", start=(-1, -1), above="10*x1 - x2 - 10", lower=(2, -50), upper=(50, 50),
        minima=((-99.96 + 100, (2, 0)),),
    ),
    "HS22": Published(
        residuals="x1 - 2, x2 - 1", start=(2, 2), above="2 - x1 - x2, x2 - x1**2", minima=((1, (1, 1)),),
    ),
    "HS23": Published(
        residuals="x1, x2", start=(3, 1), lower=(-50, -50), upper=(50, 50), minima=((2, (1, 1)),),
        above="x1 + x2 - 1, x1**2 + x2**2 - 1, 9*x1**2 + x2**2 - 9, x1**2 - x2, x2**2 - x1",
    ),
    "HS26": Published(
        residuals="x1 - x2, (x2 - x3)**2", start=(-2.6, 2, 2), equal="(1 + x2**2)*x1 + x3**4 - 3",
        minima=((0, (1, 1, 1)),), flat=True,
    ),
    "HS27": Published(
        residuals="0.1*(x1 - 1), x2 - x1**2", start=(2, 2, 2), equal="x1 + x3**2 + 1", minima=((0.04, (-1, 1, 0)),),
        flat=True,
    ),
    "HS28": Published(
        residuals="x1 + x2, x2 + x3", start=(-4, 1, 1), equal="x1 + 2*x2 + 3*x3 - 1", minima=((0, (0.5, -0.5, 0.5)),),
    ),
    "HS30": Published(
        residuals="x1, x2, x3", start=(1, 1, 1), above="x1**2 + x2**2 - 1", lower=(1, -10, -10), upper=(10, 10, 10),
        minima=((1, (1, 0, 0)),),
    ),
    "HS31": Published(
        residuals="3*x1, x2, 3*x3", start=(1, 1, 1), above="x1*x2 - 1", lower=(-10, 1, -10), upper=(10, 10, 1),
        minima=((6, (1 / sqrt(3), sqrt(3), 0)),),
    ),
    "HS32": Published(
        residuals="x1 + 3*x2 + x3, 2*(x1 - x2)", start=(0.1, 0.7, 0.2), equal="1 - x1 - x2 - x3",
        above="6*x2 + 4*x3 - x1**3 - 3", lower=(0, 0, 0), minima=((1, (0, 0, 1)),),
    ),
    "HS35": Published(
        residuals="x1 + x2 - 2, x1 + x3 - 2, x2 - 1", start=(0.5, 0.5, 0.5), above="3 - x1 - x2 - 2*x3",
        lower=(0, 0, 0), minima=((1 / 9, (4 / 3, 7 / 9, 4 / 9)),),
    ),
    "HS38": Published(
        residuals="10*(x2 - x1**2), 1 - x1, sqrt(90)*(x4 - x3**2), 1 - x3, sqrt(10)*(x2 + x4 - 2), sqrt(0.1)*(x2 - x4)",
        start=(-3, -1, -3, -1), lower=(-10,) * 4, upper=(10,) * 4, minima=((0, (1, 1, 1, 1)),),
    ),
    "HS42": Published(
        residuals="x1 - 1, x2 - 2, x3 - 3, x4 - 4", start=(1, 1, 1, 1), equal="x1 - 2, x3**2 + x4**2 - 2",
        minima=((28 - 10 * sqrt(2), (2, 2, 0.6 * sqrt(2), 0.8 * sqrt(2))),),
    ),
    "HS43": Published(
        residuals="x1 - 2.5, x2 - 2.5, sqrt(2)*(x3 - 5.25), x4 + 3.5", start=(0, 0, 0, 0),
        above="8 - x1**2 - x2**2 - x3**2 - x4**2 - x1 + x2 - x3 + x4,"
        " 10 - x1**2 - 2*x2**2 - x3**2 - 2*x4**2 + x1 + x4, 5 - 2*x1**2 - x2**2 - x3**2 - 2*x1 + x2 + x4",
        minima=((-44 + 79.875, (0, 1, 2, -1)),),
    ),
    "HS46": Published(
        residuals="x1 - x2, x3 - 1, (x4 - 1)**2, (x5 - 1)**3", start=(0.5 * sqrt(2), 1.75, 0.5, 2, 2),
        equal="x1**2*x4 + sin(x4 - x5) - 1, x2 + x3**4*x4**2 - 2", minima=((0, (1,) * 5),), flat=True,
    ),
    "HS48": Published(
        residuals="x1 - 1, x2 - x3, x4 - x5", start=(3, 5, -3, 2, -2), minima=((0, (1,) * 5),),
        equal="x1 + x2 + x3 + x4 + x5 - 5, x3 - 2*(x4 + x5) + 3",
    ),
    "HS49": Published(
        residuals="x1 - x2, x3 - 1, (x4 - 1)**2, (x5 - 1)**3", start=(10, 7, 2, -3, 0.8),
        equal="x1 + x2 + x3 + 4*x4 - 7, x3 + 5*x5 - 6", minima=((0, (1,) * 5),), flat=True,
    ),
    "HS50": Published(
        residuals="x1 - x2, x2 - x3, (x3 - x4)**2, x4 - x5", start=(35, -31, 11, 5, -5), minima=((0, (1,) * 5),),
        equal="x1 + 2*x2 + 3*x3 - 6, x2 + 2*x3 + 3*x4 - 6, x3 + 2*x4 + 3*x5 - 6",
    ),
    "HS51": Published(
        residuals=f"x1 - x2, {FIVE}", start=(2.5, 0.5, 2, -1, 0.5), minima=((0, (1,) * 5),),
        equal="x1 + 3*x2 - 4, x3 + x4 - 2*x5, x2 - x5",
    ),
    "HS52": Published(
        residuals=f"4*x1 - x2, {FIVE}", start=(2,) * 5, equal="x1 + 3*x2, x3 + x4 - 2*x5, x2 - x5",
        minima=((1859 / 349, tuple(v / 349 for v in (-33, 11, 180, -158, 11))),),
    ),
    "HS53": Published(
        residuals=f"x1 - x2, {FIVE}", start=(2,) * 5, equal="x1 + 3*x2, x3 + x4 - 2*x5, x2 - x5",
        lower=(-10,) * 5, upper=(10,) * 5, minima=((176 / 43, tuple(v / 43 for v in (-33, 11, 27, -5, 11))),),
    ),
    "HS57": Published(
        residuals=", ".join(
            f"{b} - x1 - (0.49 - x1)*exp(-x2*{a - 8})" for a, b in zip(HS57_A.tolist(), HS57_B.split(), strict=True)
        ),
        start=(0.42, 5), above="0.49*x2 - x1*x2 - 0.09", lower=(0.4, -4),
        minima=((0.02845966972, (0.419952674511, 1.28484562930)),),
    ),
    "HS60": Published(
        residuals="x1 - 1, x1 - x2, (x2 - x3)**2", start=(2, 2, 2), equal="x1*(1 + x2**2) + x3**4 - 4 - 3*sqrt(2)",
        lower=(-10,) * 3, upper=(10,) * 3, minima=((0.03256820025, (1.104859024, 1.196674194, 1.535262257)),),
    ),
    "HS61": Published(
        residuals="2*(x1 - 4.125), sqrt(2)*(x2 + 4), sqrt(2)*(x3 - 6)", start=(0, 0, 0),
        equal="3*x1 - 2*x2**2 - 7, 4*x1 - x3**2 - 11",
        minima=((-143.6461422 + 172.0625, (5.326770157, -2.118998639, 3.210464239)),),
    ),
    "HS65": Published(
        residuals="x1 - x2, (x1 + x2 - 10)/3, x3 - 5", start=(-5, 5, 0), above="48 - x1**2 - x2**2 - x3**2",
        lower=(-4.5, -4.5, -5), upper=(4.5, 4.5, 5), minima=((0.9535288567, (3.650461821, 3.65046169, 4.6204170507)),),
    ),
    "HS76": Published(
        residuals="x1 - 0.5*x3 - 0.5, sqrt(0.5)*(x2 - 3), sqrt(0.5)*(x3 + x4 - 1), 0.5*(x3 + 3)",
        start=(0.5,) * 4, above="5 - x1 - 2*x2 - x3 - x4, 4 - 3*x1 - x2 - 2*x3 + x4, x2 + 4*x3 - 1.5",
        lower=(0,) * 4, minima=((-4.681818181 + 7.5, (0.2727273, 2.090909, 0, 0.5454545)),),
    ),
    "HS77": Published(
        residuals="x1 - 1, x1 - x2, x3 - 1, (x4 - 1)**2, (x5 - 1)**3", start=(2,) * 5,
        equal="x1**2*x4 + sin(x4 - x5) - 2*sqrt(2), x2 + x3**4*x4**2 - 8 - sqrt(2)",
        minima=((0.24150513, (1.166172, 1.182111, 1.380257, 1.506036, 0.6109203)),),
    ),
    "HS79": Published(
        residuals="x1 - 1, x1 - x2, x2 - x3, (x3 - x4)**2, (x4 - x5)**2", start=(2,) * 5,
        equal="x1 + x2**2 + x3**3 - 2 - 3*sqrt(2), x2 - x3**2 + x4 + 2 - 2*sqrt(2), x1*x5 - 2",
        minima=((0.0787768209, (1.191127, 1.362603, 1.472818, 1.635017, 1.679081)),),
    ),
    "HS80": Published(
        residuals="exp(0.5*x1*x2*x3*x4*x5)", start=(-2, 2, 2, -1, -1), lower=(-2.3, -2.3, -3.2, -3.2, -3.2),
        upper=(2.3, 2.3, 3.2, 3.2, 3.2), equal="x1**2 + x2**2 + x3**2 + x4**2 + x5**2 - 10, x2*x3 - 5*x4*x5,"
        " x1**3 + x2**3 + 1", minima=((0.0539498478, (-1.717143, 1.595709, 1.827247, -0.7636413, -0.7636450)),),
        flat=True,
    ),
    "HS113": Published(
        residuals="x1 + 0.5*x2 - 7, sqrt(0.75)*(x2 - 6), x3 - 10, 2*(x4 - 5), x5 - 3, sqrt(2)*(x6 - 1), sqrt(5)*x7,"
        " sqrt(7)*(x8 - 11), sqrt(2)*(x9 - 10), x10 - 7", start=(2, 3, 5, 5, 1, 2, 7, 3, 6, 10),
        above="105 - 4*x1 - 5*x2 + 3*x7 - 9*x8, -10*x1 + 8*x2 + 17*x7 - 2*x8, 8*x1 - 2*x2 - 5*x9 + 2*x10 + 12,"
        " -3*(x1 - 2)**2 - 4*(x2 - 3)**2 - 2*x3**2 + 7*x4 + 120, -5*x1**2 - 8*x2 - (x3 - 6)**2 + 2*x4 + 40,"
        " -0.5*(x1 - 8)**2 - 2*(x2 - 4)**2 - 3*x5**2 + x6 + 30, -x1**2 - 2*(x2 - 2)**2 + 2*x1*x2 - 14*x5 + 6*x6,"
        " 3*x1 - 6*x2 - 12*(x9 - 8)**2 + 7*x10",
        minima=((24.3062091 - 45 + 76, (
            2.171996, 2.363683, 8.773926, 5.095984, 0.9906548, 1.430574, 1.321644, 9.828726, 8.280092, 8.375927,
        )),),
    ),
}  # fmt: skip
