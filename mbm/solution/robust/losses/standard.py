"""The losses that mbm brings, one for each name that ``:loss`` knows."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.problem.kinds import LossKind
from mbm.solution.robust.losses.barron import BARRON
from mbm.solution.robust.losses.cauchy import CAUCHY
from mbm.solution.robust.losses.geman_mcclure import GEMAN_MCCLURE
from mbm.solution.robust.losses.huber import HUBER
from mbm.solution.robust.losses.soft_l1 import SOFT_L1
from mbm.solution.robust.losses.tukey import TUKEY
from mbm.solution.robust.losses.types import RobustLoss

BY_KIND: Mapping[LossKind, RobustLoss] = MappingProxyType(
    {loss.kind: loss for loss in (HUBER, SOFT_L1, CAUCHY, TUKEY, GEMAN_MCCLURE, BARRON)}
)
