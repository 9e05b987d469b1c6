"""What all tests share: nothing is taken from, or left in, the caches of the user who runs them.

Collected and reckoned as by the command line: what is loaded stays, and each matrix has one thread. Two processes of
tests with two threads each wait for one another on two cores: large problems take up to sixteen times the time.
"""

from __future__ import annotations

import gc
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from mbm.cli.main import BLAS_THREADS, COLLECTED
from mbm.kernels.store import VARIABLE

settings.register_profile("untimed", deadline=None)  # no test asserts how long anything takes
settings.load_profile("untimed")

gc.set_threshold(COLLECTED, *gc.get_threshold()[1:])
for variable in BLAS_THREADS:
    os.environ.setdefault(variable, "1")


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--update-golden``: the generated solver as it is becomes the one that is expected."""
    parser.addoption("--update-golden", action="store_true", help="write the golden files of tests/emit anew")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says how many tests were skipped, by reason: evidence that was not looked at is none."""
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = Counter(report.longrepr[2].removeprefix("Skipped: ") for report in skipped)
    for reason, count in sorted(reasons.items()):
        terminalreporter.write_line(f"skipped {count:>4}: {reason}")


def _shared_folder(factory: pytest.TempPathFactory, name: str) -> Path:
    """A folder of this run, empty at its beginning: the same one for all processes among which tests are shared out."""
    whole = factory.getbasetemp().parent if "PYTEST_XDIST_WORKER" in os.environ else factory.getbasetemp()
    folder = whole / name
    folder.mkdir(mode=0o700, exist_ok=True)  # a cache that others may write to is not used
    return folder


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache for the run, empty at its beginning; the processes that tests start inherit it."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(_shared_folder(tmp_path_factory, "cache"))
    yield
    if before is None:
        del os.environ[VARIABLE]
    else:
        os.environ[VARIABLE] = before


@pytest.fixture(scope="session", autouse=True)
def _own_byte_code(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A place for byte code where none is to be written: else each process that a test starts compiles mbm anew."""
    with pytest.MonkeyPatch.context() as patch:
        if sys.dont_write_bytecode:
            patch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
            patch.setenv("PYTHONPYCACHEPREFIX", str(_shared_folder(tmp_path_factory, "bytecode")))
        yield
