"""The routines for blocks of given sizes as one module, each product of blocks under a name of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from mbm.target.blocks import elimination, frontal, ordering, products, substitution
from mbm.target.blocks.names import product_name
from mbm.target.from_python import module_of
from mbm.target.tree import Function, Module

PLAIN: tuple[Callable[..., object], ...] = (
    products.put_inputs,
    products.put_nonzeros,
    products.add_gradient,
    products.add_squares,
    products.put_image,
)
"""Routines for blocks of any size."""

INNER: tuple[Callable[..., object], ...] = (
    elimination.subtract_three,
    elimination.subtract_one,
    elimination.subtract_product,
    elimination.subtract_links,
    elimination.subtract_line,
    substitution.carry,
    substitution.bring_back,
    substitution.put_images,
    substitution.put_between,
)
"""What other routines call."""

ELIMINATION: tuple[Callable[..., object], ...] = (
    elimination.inverse_roots,
    elimination.put_couplings,
    elimination.reduce_members,
    elimination.reduce_blocks,
    elimination.reduce_sparse,
    substitution.solve_triangular,
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

INSIDE_FRONTS: tuple[Callable[..., object], ...] = (
    ordering.unlisted,
    ordering.listed,
    ordering.put_clique,
    ordering.measure_elements,
    ordering.updated_degree,
    ordering.list_nodes,
    ordering.bounded_degree,
    frontal.subtract_pair,
    frontal.subtract_multiple,
    frontal.product,
    frontal.factorise_front,
    frontal.add_update,
    frontal.inverse_front,
)
"""What they call."""


def fronts_module() -> Module:
    """The routines for fronts."""
    return module_of("fronts", (*INSIDE_FRONTS, *FRONTS), [f.__name__ for f in FRONTS])


def blocks_module(sizes: Iterable[tuple[int, int]], size: int | None) -> Module:
    """All routines: products for the ``sizes`` (outputs, right), elimination of members of ``size`` columns."""
    found: list[Function] = list(module_of("blocks", PLAIN, [f.__name__ for f in PLAIN]).functions)
    for outputs, right in sizes:
        constants = {"OUTPUTS": outputs, "RIGHT": right}
        routine = products.add_products
        (one,) = module_of("product", [routine], [routine.__name__], constants=constants).functions
        found.append(replace(one, name=product_name(outputs, right)))
    if size is not None:
        names = [f.__name__ for f in ELIMINATION]
        found.extend(module_of("elimination", (*INNER, *ELIMINATION), names, constants={"SIZE": size}).functions)
    return Module(name="blocks", functions=tuple(found))
