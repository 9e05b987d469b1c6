"""mbm: a compiler for measurement problems.

>>> import mbm
>>> result = mbm.load("tag.mbm").solve()
>>> result["p"].value, result["p"].sigma

Everything is loaded when it is first used, so that ``import mbm`` costs nothing.
"""

from mbm.version import __version__

TYPE_CHECKING = False  # `typing` would be imported from the folder of `python -m mbm`
if TYPE_CHECKING:
    from typing import Any

    from mbm.api import CompiledProblem, MbmError, Problem, Solve, Solved, build, keyword, load, loads, symbol

__all__ = [
    "CompiledProblem",
    "MbmError",
    "Problem",
    "Solve",
    "Solved",
    "__version__",
    "build",
    "keyword",
    "load",
    "loads",
    "symbol",
]


def __getattr__(name: str) -> "Any":
    if name in __all__:
        from mbm import api

        return getattr(api, name)
    message = f"module `mbm` has no attribute `{name}`"
    raise AttributeError(message)


def __dir__() -> list[str]:
    return sorted(__all__)
