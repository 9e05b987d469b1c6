"""Expressions → their Jacobian, branch by branch where they are piecewise."""

from __future__ import annotations

import casadi

from mbm.kernels.lowering import Lowered


def differentiated(lowered: Lowered, variables: casadi.SX) -> tuple[casadi.SX, casadi.SX]:
    """Values and Jacobian. Piecewise values are differentiated branch by branch and then chosen from.

    Automatic differentiation of a choice multiplies the derivative of the branch not taken by zero, which makes NaN of
    the infinite slope of ``sqrt`` at zero that the condition was there to avoid.
    """
    values = casadi.densify(casadi.vertcat(*lowered.expressions))
    if not lowered.choices:
        return values, casadi.jacobian(values, variables)
    count = int(variables.numel())
    slopes: dict[int, casadi.SX] = {}
    known: list[casadi.SX] = []
    chosen: list[casadi.SX] = []

    def total(expression: casadi.SX) -> casadi.SX:
        """The Jacobian with those of the choices that ``expression`` uses, by the chain rule."""
        result = casadi.jacobian(expression, variables)
        used = [symbol for symbol in casadi.symvar(expression) if symbol.element_hash() in slopes]
        if used:  # all at once: one after the other, each would go through the whole expression
            by_choice = casadi.jacobian(expression, casadi.vertcat(*used))
            result = result + casadi.mtimes(by_choice, casadi.vertcat(*(slopes[s.element_hash()] for s in used)))
        return result

    for choice in lowered.choices:
        then, other = casadi.densify(total(choice.then)), casadi.densify(total(choice.other))
        pairs = [casadi.if_else(choice.test, then[j], other[j]) for j in range(count)]
        slopes[choice.symbol.element_hash()] = casadi.sparsify(casadi.horzcat(*pairs)) if pairs else casadi.SX(1, 0)
        known.append(choice.symbol)
        chosen.append(casadi.if_else(choice.test, choice.then, choice.other))
    _, (values, jacobian) = casadi.substitute_inplace(known, chosen, [values, total(values)])
    return values, jacobian
