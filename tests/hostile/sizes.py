"""Attacks by size: how large, decided by bytes, evenly over the orders of magnitude."""

from __future__ import annotations

from tests.trials.choices import Choices

STEPS = 65_536


def size(choices: Choices, least: int, most: int) -> int:
    """A whole number from ``least`` to ``most``, each power of ten as likely as any other."""
    part = choices.below(STEPS) / (STEPS - 1)
    return min(max(round(least * (most / least) ** part), least), most)


def digits(choices: Choices, most: int) -> str:
    """A number that is long to write: whole, a fraction, or with an exponent."""
    many = "".join(str(choices.below(10)) for _ in range(8)) * (size(choices, 8, most) // 8)
    return choices.one_of((many, f"-{many}", f"0.{many}", f"1e{many}", f"1e-{many}", f"{many}e{many}", f"{many}/3"))
