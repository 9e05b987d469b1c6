"""What is plugged in: one immutable value, made here and passed as an argument; no module holds any of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbm.data.readers import READERS
from mbm.data.types import ManyReader, Reader
from mbm.language.evaluator import Vocabulary
from mbm.language.limits import Limits
from mbm.shapes.vocabulary import vocabulary

if TYPE_CHECKING:
    from mbm.kernels.types import Backend
    from mbm.solution.closed_forms.types import ClosedForm
    from mbm.solution.robust.estimators.types import ConsensusEstimator
    from mbm.solution.robust.losses.types import RobustLoss


def _casadi() -> Backend:
    from mbm.kernels.backends.casadi_map import BACKEND

    return BACKEND


def _numpy() -> Backend:
    from mbm.kernels.backends.numpy_stream import BACKEND

    return BACKEND


def _automatic() -> Backend:
    from mbm.kernels.backends.automatic import BACKEND

    return BACKEND


def _closed_forms() -> tuple[ClosedForm, ...]:
    from mbm.solution.closed_forms.standard import STANDARD

    return STANDARD


def _losses() -> tuple[RobustLoss, ...]:
    from mbm.solution.robust.losses.standard import STANDARD

    return STANDARD


def _estimators() -> tuple[ConsensusEstimator, ...]:
    from mbm.solution.robust.estimators.standard import STANDARD

    return STANDARD


_BACKENDS: Mapping[str, Callable[[], Backend]] = MappingProxyType(
    {"auto": _automatic, "casadi": _casadi, "numpy": _numpy}
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """Vocabulary, readers by name, what makes a backend by the name that ``--backend`` gives it, and the closed forms.

    What gives the closed forms is called where they are needed: a warm start does without them. ``losses`` and
    ``estimators`` list what ``:loss`` and ``:robust`` name; the language fixes those names, so nothing adds to them.
    """

    vocabulary: Vocabulary
    readers: Mapping[str, Reader | ManyReader] = field(default_factory=lambda: READERS)
    backends: Mapping[str, Callable[[], Backend]] = field(default_factory=lambda: _BACKENDS)
    closed_forms: Callable[[], tuple[ClosedForm, ...]] = _closed_forms
    losses: Callable[[], tuple[RobustLoss, ...]] = _losses
    estimators: Callable[[], tuple[ConsensusEstimator, ...]] = _estimators
    limits: Limits = field(default_factory=Limits)


ENTRY_POINTS = "mbm.closed_forms"
"""The group of entry points by which Python packages add closed forms."""


def standard_registry(closed_forms: tuple[ClosedForm, ...] = ()) -> Registry:
    """What mbm itself brings, and what packages add; ``closed_forms`` of the caller are tried before all others."""
    # packages are asked once, not for each solve
    forms = cache(lambda: (*closed_forms, *_installed(), *_closed_forms()))
    return Registry(vocabulary=vocabulary(), closed_forms=forms)


def _installed() -> tuple[ClosedForm, ...]:
    """The closed forms that installed packages announce, by name."""
    from importlib.metadata import entry_points

    found = sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)
    return tuple(point.load() for point in found)
