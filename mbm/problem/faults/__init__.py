"""Diagnostics of the problem stage: what clauses may say wrongly, and what does not go with the data."""

from mbm.problem.faults.clauses import *  # noqa: F403 - one room, two files
from mbm.problem.faults.data import *  # noqa: F403
