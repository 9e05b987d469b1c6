"""How constraints, losses and what becomes of free motions are called, and what an equation demands."""

from __future__ import annotations

from enum import StrEnum


class Relation(StrEnum):
    """What an equation demands of its components; the value is how constraints are reported."""

    NEAR_ZERO = "observed"
    ZERO = "="
    NOT_ABOVE_ZERO = "<="


class ConstraintKind(StrEnum):
    """How a constraint is written; the value is its head, and what the result document calls its type."""

    EQUAL = "="
    BELOW = "<"
    NOT_ABOVE = "<="
    ABOVE = ">"
    NOT_BELOW = ">="
    UNIFORM = "uniform"


class LossKind(StrEnum):
    """Robust losses; the value is the name in ``:loss``."""

    HUBER = "huber"
    SOFT_L1 = "soft-l1"
    CAUCHY = "cauchy"
    TUKEY = "tukey"
    GEMAN_MCCLURE = "geman-mcclure"
    BARRON = "barron"


class Gauge(StrEnum):
    """What becomes of common motions that no equation notices; the value is the name in ``:gauge``."""

    REPORT = "report"
    FREE = "free"


class ConstraintMethod(StrEnum):
    """How constraints are met; the value is the name in ``:constraints``."""

    PENALTY = "penalty"
    EXACT = "exact"


class ConsensusKind(StrEnum):
    """Consensus estimators; the value is the name in ``:robust``."""

    LMEDS = "lmeds"
    RANSAC = "ransac"
    MSAC = "msac"
    GNC = "gnc"
