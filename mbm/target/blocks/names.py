"""Names of routines that depend on sizes: known without loading the routines themselves."""

from __future__ import annotations


def product_name(outputs: int, right: int) -> str:
    """The name of the routine that adds up products of blocks with right ones of shape (outputs, right)."""
    return f"add_products_{outputs}_{right}"
