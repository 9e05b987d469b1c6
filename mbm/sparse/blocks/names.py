"""Sizes, and names of routines that depend on them: known without loading the routines themselves."""

from __future__ import annotations

SIZE = 3
"""Columns of a member of the family that is eliminated; the texts are read with that of each problem in its place."""


def product_name(outputs: int, right: int) -> str:
    """The name of the routine that adds up products of blocks with right ones of shape (outputs, right)."""
    return f"add_products_{outputs}_{right}"
