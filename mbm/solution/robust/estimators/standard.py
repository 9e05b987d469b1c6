"""The consensus estimators that mbm brings, one for each name that ``:robust`` knows."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.estimators.gnc import GNC
from mbm.solution.robust.estimators.lmeds import LMEDS
from mbm.solution.robust.estimators.msac import MSAC
from mbm.solution.robust.estimators.ransac import RANSAC
from mbm.solution.robust.estimators.types import ConsensusEstimator

BY_KIND: Mapping[ConsensusKind, ConsensusEstimator] = MappingProxyType(
    {each.kind: each for each in (LMEDS, RANSAC, MSAC, GNC)}
)
