"""The routines for blocks of given sizes as one module, each product of blocks under a name of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from mbm.machine.from_python import module_of
from mbm.machine.tree import Module
from mbm.sparse.blocks import elimination, frontal, ordering, products, substitution
from mbm.sparse.blocks.names import product_name

PLAIN: tuple[Callable[..., object], ...] = (
    products.put_inputs,
    products.put_nonzeros,
    products.add_gradient,
    products.add_squares,
    products.put_image,
    substitution.solve_triangular,
)
"""Routines for blocks of any size."""

ELIMINATION: tuple[Callable[..., object], ...] = (
    elimination.inverse_roots,
    elimination.put_couplings,
    elimination.reduce_members,
    elimination.reduce_blocks,
    elimination.reduce_sparse,
    substitution.put_rooted,
    substitution.add_coupled,
    substitution.add_coupled_once,
    substitution.images_dense,
    substitution.images_sparse,
    substitution.put_inverse_blocks,
    substitution.put_diagonals,
)
"""Routines for the elimination of a family with members of one size."""

FRONTS: tuple[Callable[..., object], ...] = (
    ordering.order_nodes,
    frontal.factorise_fronts,
    frontal.solve_fronts,
    frontal.inverse_fronts,
)
"""The elimination order, and routines for fronts of any size."""


def fronts_module() -> Module:
    """The routines for fronts."""
    return module_of("fronts", FRONTS)


def blocks_module(sizes: Iterable[tuple[int, int]], size: int | None) -> Module:
    """All routines: products for the ``sizes`` (outputs, right), elimination of members of ``size`` columns."""
    parts = [module_of("blocks", PLAIN)]
    for outputs, right in sizes:
        part = module_of("product", [products.add_products], constants={"OUTPUTS": outputs, "RIGHT": right})
        named = tuple(replace(each, name=product_name(outputs, right)) for each in part.functions)
        parts.append(replace(part, functions=named))
    if size is not None:
        parts.append(module_of("elimination", ELIMINATION, constants={"SIZE": size}))
    functions = tuple(each for part in parts for each in part.functions)
    records = {each.name: each for part in parts for each in part.records}
    return Module(name="blocks", functions=functions, records=tuple(records.values()))
