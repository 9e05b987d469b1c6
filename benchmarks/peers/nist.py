"""NIST StRD with the default settings of other fitting programs: estimates and seconds of every fit."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from time import process_time

import numpy as np

from benchmarks.peers import main
from tests.estimation.nist import MODELS

Model = Callable[[np.ndarray, np.ndarray], np.ndarray]


def scipy_lm(model: Model, x: np.ndarray, y: np.ndarray, start: np.ndarray) -> np.ndarray:
    from scipy.optimize import least_squares

    return least_squares(lambda b: model(b, x) - y, start, method="lm").x


def curve_fit(model: Model, x: np.ndarray, y: np.ndarray, start: np.ndarray) -> np.ndarray:
    from scipy.optimize import curve_fit as fit

    return fit(lambda x, *b: model(np.array(b), x), x, y, p0=start)[0]


def lmfit(model: Model, x: np.ndarray, y: np.ndarray, start: np.ndarray) -> np.ndarray:
    from lmfit import Parameters, minimize

    names = [f"b{i}" for i in range(len(start))]
    parameters = Parameters()
    for name, value in zip(names, start, strict=True):
        parameters.add(name, value=value)
    found = minimize(lambda p: model(np.array([p[n].value for n in names]), x) - y, parameters)
    return np.array([found.params[n].value for n in names])


def odrpack(model: Model, x: np.ndarray, y: np.ndarray, start: np.ndarray) -> np.ndarray:
    from odrpack import odr_fit

    return odr_fit(lambda x, b: model(b, x), x, y, start, task="OLS").beta


PEERS = {"lmfit": lmfit, "curve_fit": curve_fit, "SciPy lm": scipy_lm, "odrpack": odrpack}


def answer(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, list[float] | float]]:
    """Arrays ``SET/x``, ``SET/y``, ``SET/start/1`` … → per peer the estimates of each fit (NaN: refused), seconds."""
    found = {}
    fits = sorted(name for name in arrays if "/start/" in name)
    for peer, fit in PEERS.items():
        estimates, seconds = {}, 0.0
        for name in fits:
            head, start = name.split("/")[0], arrays[name]
            data = MODELS[head], arrays[f"{head}/x"], arrays[f"{head}/y"], start
            began = process_time()
            try:
                with warnings.catch_warnings(), np.errstate(all="ignore"):
                    warnings.simplefilter("ignore")
                    estimates[name] = [float(v) for v in fit(*data)]
            except (RuntimeError, ValueError, ArithmeticError):
                estimates[name] = [float("nan")] * len(start)
            seconds += process_time() - began
        found[peer] = {"estimates": estimates, "seconds": seconds}
    return found


if __name__ == "__main__":
    main(answer)
