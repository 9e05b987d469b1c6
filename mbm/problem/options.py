"""Clauses as a head, positional forms and keyword options."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.language import faults
from mbm.text.suggest import closest
from mbm.text.types import Form, Keyword, MbmError, Sequence, Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What stands in a clause after its head."""

    positional: tuple[Form, ...]
    keywords: Mapping[str, Form]
    repeated: Mapping[str, tuple[Form, ...]]
    places: Mapping[str, Span]
    span: Span

    def get(self, name: str) -> Form | None:
        """The form behind ``:name``, or None."""
        return self.keywords.get(name)


def split_options(
    items: tuple[Form, ...],
    span: Span,
    *,
    owner: str,
    known: tuple[str, ...],
    repeatable: tuple[str, ...] = (),
    not_yet: Mapping[str, str] | None = None,
) -> Options:
    """Sort ``items`` into positional forms and ``:keyword value`` pairs.

    Raises:
        MbmError: an option that is unknown, given twice, without a value, or not available yet.

    """
    later = not_yet or {}
    positional: list[Form] = []
    keywords: dict[str, Form] = {}
    repeated: dict[str, list[Form]] = {}
    places: dict[str, Span] = {}
    position = 0
    while position < len(items):
        item = items[position]
        if not isinstance(item, Keyword):
            positional.append(item)
            position += 1
            continue
        if item.name in later:
            raise MbmError(faults.not_available_yet(item.span, f"`:{item.name}`", later[item.name]))
        if item.name not in known and item.name not in repeatable:
            near = closest(item.name, known)
            raise MbmError(faults.unknown_keyword(item.span, item.name, owner, (near,) if near else known))
        if position + 1 >= len(items) or isinstance(items[position + 1], Keyword):
            raise MbmError(faults.missing_keyword_value(item.span, item.name))
        if item.name in repeatable:
            repeated.setdefault(item.name, []).append(items[position + 1])
        elif item.name in keywords:
            raise MbmError(faults.duplicate_definition(item.span, f":{item.name}", places[item.name]))
        else:
            keywords[item.name] = items[position + 1]
        places[item.name] = item.span
        position += 2
    return Options(
        positional=tuple(positional),
        keywords=keywords,
        repeated={k: tuple(v) for k, v in repeated.items()},
        places=places,
        span=span,
    )


def only(clauses: list[Sequence], name: str) -> Sequence | None:
    """The clause that may stand once in a problem; None where there is none.

    Raises:
        MbmError: it stands several times.

    """
    for other in clauses[1:]:
        raise MbmError(faults.duplicate_definition(other.span, name, clauses[0].span))
    return clauses[0] if clauses else None
