"""What ``:loss`` and ``:robust`` may say wrongly."""

from __future__ import annotations

from mbm.solver.losses import LOSSES
from mbm.text.types import Code, Diagnostic, Span

_LOSSES = [f"`({kind} a c)`" if traits.shaped else f"`{kind}`" for kind, traits in LOSSES.items()]

UNKNOWN_LOSS = Code(
    "unknown-loss",
    "`:loss` names no robust loss.",
    f"Use `none`, {', '.join(_LOSSES[:-1])} or {_LOSSES[-1]}.",
)
UNKNOWN_CONSENSUS = Code(
    "unknown-consensus",
    "`:robust` names no way to find the measurements that agree.",
    "Use `none`, `lmeds`, `ransac`, `msac` or `gnc`.",
)


def unknown_loss(span: Span, name: str, near: str | None, known: tuple[str, ...]) -> Diagnostic:
    """A loss nobody knows."""
    hint = f"did you mean `{near}`?" if near else f"the losses are {_listed(known)}"
    return Diagnostic(code=UNKNOWN_LOSS, message=f"`{name}` is no loss", place=span, hint=hint)


def unknown_consensus(span: Span, name: str, near: str | None, known: tuple[str, ...]) -> Diagnostic:
    """A consensus estimator nobody knows."""
    hint = f"did you mean `{near}`?" if near else f"they are {_listed(known)}"
    return Diagnostic(
        code=UNKNOWN_CONSENSUS, message=f"`{name}` is no consensus estimator", place=span, hint=hint
    )  # fmt: skip


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{n}`" for n in names)
