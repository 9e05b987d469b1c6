"""A matrix that is made when it is first looked at: what solves and reports seldom ask for costs nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class DeferredMatrix:
    """Behaves as the SciPy sparse array of the given ``shape`` that ``make`` makes, once."""

    __array_ufunc__ = None  # products with NumPy's arrays are left to this class

    def __init__(self, shape: tuple[int, int], make: Callable[[], Any]) -> None:
        self.shape = shape
        self._make = make
        self._made: Any = None

    @property
    def matrix(self) -> Any:
        """The matrix itself."""
        if self._made is None:
            self._made = self._make()
        return self._made

    def __matmul__(self, other: Any) -> Any:
        return self.matrix @ other

    def __rmatmul__(self, other: Any) -> Any:
        return other @ self.matrix

    def __mul__(self, other: Any) -> Any:
        return self.matrix * other

    def __rmul__(self, other: Any) -> Any:
        return other * self.matrix

    def __abs__(self) -> Any:
        return abs(self.matrix)

    def __getitem__(self, key: Any) -> Any:
        return self.matrix[key]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.matrix, name)
