"""Whatever stands in a problem file or its data, the answer is a result or diagnostics: never anything else.

10,000 cases, the same in every run; ``MBM_FUZZ_CASES=1000000`` (``make fuzz``) tries as many others.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.fuzz.choices import Choices
from tests.fuzz.mutations import CELL, ODD_CELLS, mutated_bytes, mutated_text
from tests.fuzz.outcome import faults_of, folder_with_data, known_codes, outcome
from tests.fuzz.problems import problem_file

ROOT = Path(__file__).parents[2]
CASES = int(os.environ.get("MBM_FUZZ_CASES", "10000"))
SEARCHING = "MBM_FUZZ_CASES" in os.environ
CODES = known_codes()
DECISIONS = st.binary(min_size=320, max_size=320)


def _share(part: float) -> settings:
    """Settings for a part of the cases; failures are made small, but not collected or explained."""
    return settings(
        max_examples=max(int(CASES * part), 1),
        derandomize=not SEARCHING,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
        report_multiple_bugs=False,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_with_data(tmp_path_factory.mktemp("fuzz"))


@pytest.fixture(scope="module")
def examples(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Copies of sound and of faulty problem files, with their data beside them."""
    sources = [ROOT / "tests" / "bad", *(ROOT / "mbm" / "cli" / "templates").iterdir(), *(ROOT / "problems").iterdir()]
    home = tmp_path_factory.mktemp("examples")
    for source in sources:
        if source.is_dir():
            shutil.copytree(source, home / source.name, ignore=shutil.ignore_patterns("*.py", "*.png", "__pycache__"))
    return sorted(path for path in home.rglob("*.mbm") if path.stat().st_size < 20_000)


def _assert_answered(command: str, file: Path, *options: str) -> None:
    found = outcome(command, str(file), "--json", "-", *options)
    wrong = faults_of(found, file.parent, CODES)
    assert not wrong, f"{wrong}\n{found.err[-2000:]}"


def test_the_codes_were_found() -> None:
    assert {"unclosed-bracket", "unknown-name", "bad-cell", "not-available-yet"} <= CODES


@_share(0.57)
@given(decisions=DECISIONS)
def test_generated_problems_are_checked(folder: Path, decisions: bytes) -> None:
    file = folder / "generated.mbm"
    file.write_text(problem_file(decisions), encoding="utf-8")
    _assert_answered("check", file)


@_share(0.03)  # a solve takes as long as ten checks
@given(decisions=DECISIONS)
def test_generated_problems_are_solved(folder: Path, decisions: bytes) -> None:
    file = folder / "solved.mbm"
    file.write_text(problem_file(decisions), encoding="utf-8")
    # machine code of a problem takes longer to make than its solve: every eighth has it
    _assert_answered("solve", file, "--backend", "auto" if decisions[0] % 8 == 0 else "numpy")


@_share(0.25)
@given(decisions=st.binary(min_size=24, max_size=24))
def test_mutated_problems_are_checked(examples: list[Path], decisions: bytes) -> None:
    choices = Choices(decisions)
    example = choices.one_of(examples)
    file = example.parent / "mutated-copy.mbm"
    if choices.chance(5):
        file.write_bytes(mutated_bytes(example.read_bytes(), choices))
    else:
        file.write_text(mutated_text(example.read_text(encoding="utf-8", errors="replace"), choices), encoding="utf-8")
    _assert_answered("check", file)


@_share(0.08)
@given(decisions=st.binary(min_size=24, max_size=24))
def test_mutated_data_are_checked(folder: Path, decisions: bytes) -> None:
    choices = Choices(decisions)
    home = folder / "data"
    home.mkdir(exist_ok=True)
    folder_with_data(home)
    file = home / "sound.mbm"
    file.write_text(problem_file(b""), encoding="utf-8")
    table = home / choices.one_of(("nodes.csv", "readings.csv"))
    content = mutated_text(table.read_text(encoding="utf-8"), choices, CELL, ODD_CELLS).encode()
    table.write_bytes(mutated_bytes(content, choices) if choices.chance(3) else content)
    _assert_answered("check", file)


@_share(0.07)
@given(
    content=st.one_of(st.binary(max_size=200), st.text(st.sampled_from("()[]'`,@;#|\"\\ \na1-./:%é\x00"), max_size=60))
)
def test_noise_is_answered(folder: Path, content: bytes | str) -> None:
    file = folder / "noise.mbm"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    _assert_answered("check", file)
