"""Diagnostics of the problem stage: what clauses may say wrongly, and what does not go with the data."""

from mbm.problem.faults.clauses import *  # noqa: F403 - one room, several files
from mbm.problem.faults.data import *  # noqa: F403
from mbm.problem.faults.given import *  # noqa: F403
from mbm.problem.faults.noise import *  # noqa: F403
from mbm.problem.faults.sequences import *  # noqa: F403
