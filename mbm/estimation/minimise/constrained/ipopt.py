"""``:method ipopt``: the interior-point method of Wächter and Biegler (2006), as CasADi brings it.

It sees the cost and the constraints as functions of a step from the start in scaled coordinates, with their gradients;
the Hessian is approximated on the way. The compiled solver gives the last digits, the multipliers and the active set.
"""

from __future__ import annotations

from typing import Any, Protocol, cast

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.minimise.constrained.linearise import linearise
from mbm.estimation.minimise.constrained.types import ConstrainedEquations

PRECISION = 1e-8
STUCK = {
    "acceptable_iter": 5,
    "acceptable_obj_change_tol": 1e-14,
    "acceptable_constr_viol_tol": 1e-6,
    **dict.fromkeys(("acceptable_tol", "acceptable_dual_inf_tol", "acceptable_compl_inf_tol"), 1e20),
}
"""Ipopt's own rule for an end before `PRECISION`: five iterations in a row that change a cost only in its last digits,
at a point that keeps the constraints. A gradient that is all rounding, as that of rows with weights of 1e20, would
otherwise be searched along, fifty evaluations each time, until ``max_iter``."""


class _Charted(Protocol):
    def chart_slopes(self, x: Floats, step: Floats) -> Floats: ...


def last_step(equations: ConstrainedEquations, point: Floats) -> Floats:
    """The point after one Gauss-Newton step, if that stays inside the bounds and no cost shows a loss.

    Beside rows of great weight the cost does not tell what Ipopt leaves of the way for the others.
    """
    here = linearise(equations, point)
    step = -np.linalg.lstsq(here.jacobian / here.scale, here.residuals, rcond=None)[0] / here.scale
    there = equations.retract(point, step)
    coordinates, residuals = equations.coordinates(there), equations.residuals(there)
    inside = bool(((coordinates >= equations.lower) & (coordinates <= equations.upper)).all())
    length = float(np.sqrt(residuals @ residuals))
    return there if inside and length <= np.sqrt(here.cost) + here.noise else point


class _Along:
    """Cost and constraints over the scaled step (n,) from a point."""

    def __init__(self, equations: ConstrainedEquations, start: Floats) -> None:
        self.equations = equations
        self.start = start
        here = linearise(equations, start)
        self.scale, self.unit = here.scale, here.unit

    def cost(self, step: Floats) -> float:
        """Half the sum of squares."""
        residuals = self.equations.residuals(self._point(step))
        return 0.5 * float(residuals @ residuals)

    def conditions(self, step: Floats) -> Floats:
        """The constraints (k,) in their units."""
        return self.equations.constraint_values(self._point(step)) / self.unit

    def gradient(self, step: Floats) -> Floats:
        """Of the cost (n,)."""
        point = self._point(step)
        return self.equations.residuals(point) @ self.equations.jacobian(point) @ self._chart(step)

    def slopes(self, step: Floats) -> Floats:
        """The Jacobian (k, n) of the constraints."""
        return (self.equations.constraint_jacobian(self._point(step)) @ self._chart(step)) / self.unit[:, None]

    def _point(self, step: Floats) -> Floats:
        return self.equations.retract(self.start, step / self.scale)

    def _chart(self, step: Floats) -> Floats:
        """How the step that belongs to the point changes with the one from the start (n, n)."""
        turned = np.eye(len(step))
        if hasattr(self.equations, "chart_slopes"):
            turned = cast(_Charted, self.equations).chart_slopes(self.start, step / self.scale)
        return turned / self.scale


def interior_point(equations: ConstrainedEquations, start: Floats, limit: int) -> Floats:
    """Where Ipopt gets from the start in so many iterations."""
    along = _Along(equations, start)
    import casadi

    size, count = equations.dimension, len(along.unit)
    objective, conditions = _callbacks(casadi, along, size, count)
    step = casadi.MX.sym("step", size)
    options: Any = {
        "print_time": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": limit,
            "tol": PRECISION,
            "hessian_approximation": "limited-memory",
            **STUCK,
        },
    }
    problem = {"x": step, "f": objective(step)}
    if count:
        problem["g"] = conditions(step)
    solver = casadi.nlpsol("solver", "ipopt", problem, options)
    centre = equations.coordinates(along.start)
    low, high = (np.asarray((bound - centre) * along.scale) for bound in (equations.lower, equations.upper))
    lower_limit = np.where(equations.equality, 0.0, -np.inf)
    answer = solver(x0=np.zeros(size), lbx=low, ubx=high, lbg=lower_limit, ubg=np.zeros(count))
    found = np.asarray(answer["x"]).ravel()
    return equations.retract(along.start, found / along.scale) if bool(np.isfinite(found).all()) else along.start


def _callbacks(casadi: Any, along: _Along, size: int, count: int) -> tuple[Any, Any]:
    """CasADi's functions of the step for the cost and the constraints; their derivatives are ours."""

    class Value(casadi.Callback):  # type: ignore[misc]
        def __init__(self, name: str, rows: int, value: Any, slope: Any) -> None:
            casadi.Callback.__init__(self)
            self.rows, self.value, self.slope = rows, value, slope
            self.construct(name, {})

        def get_n_in(self) -> int:
            return 1

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, _: int) -> Any:
            return casadi.Sparsity.dense(size, 1)

        def get_sparsity_out(self, _: int) -> Any:
            return casadi.Sparsity.dense(self.rows, 1)

        def eval(self, arguments: Any) -> Any:
            return [casadi.DM(self.value(np.asarray(arguments[0]).ravel()))]

        def has_jacobian(self) -> bool:
            return True

        def get_jacobian(self, name: str, *_: Any) -> Any:
            self.derivative = Slope(name, self.rows, self.slope)
            return self.derivative

    class Slope(casadi.Callback):  # type: ignore[misc]
        def __init__(self, name: str, rows: int, slope: Any) -> None:
            casadi.Callback.__init__(self)
            self.rows, self.slope = rows, slope
            self.construct(name, {})

        def get_n_in(self) -> int:
            return 2

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, place: int) -> Any:
            return casadi.Sparsity.dense(size, 1) if place == 0 else casadi.Sparsity.dense(self.rows, 1)

        def get_sparsity_out(self, _: int) -> Any:
            return casadi.Sparsity.dense(self.rows, size)

        def eval(self, arguments: Any) -> Any:
            return [casadi.DM(self.slope(np.asarray(arguments[0]).ravel()))]

    objective = Value("cost", 1, along.cost, lambda step: along.gradient(step)[None, :])
    conditions = Value("conditions", count, along.conditions, along.slopes)
    return objective, conditions
