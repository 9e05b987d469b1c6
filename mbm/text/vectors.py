"""Forms → the paren vectors in problems that mean the same when they are written with square brackets."""

from __future__ import annotations

from mbm.text.types import Bracket, Form, Keyword, Numeral, Sequence, Symbol

_ARITHMETIC = (
    "+ - * / ^ sqrt exp log log10 abs min max sign mod floor hypot sin cos tan asin acos atan atan2 sinh cosh tanh"
)
_COMPARISON = "= < <= > >= and or not if"
_VECTORS = "dot cross norm distance normalize addvv subvv mulmv transpose @ outer det identity list"
_FRAMES = (
    "euler rot-x rot-y rot-z rot2 axis-angle quaternion look-at pose2 pose3 rotation translation heading "
    "trans rotate scale transform inverse compose between"
)
_OBSERVABLES = (
    "project perse vertex-on-image line-on-image vertex-on-line line-through image-line "
    "point-line-distance point-plane-distance bearing elevation normal uniform"
)
EVALUATING = frozenset(" ".join((_ARITHMETIC, _COMPARISON, _VECTORS, _FRAMES, _OBSERVABLES)).split())
"""Built-in heads all of whose arguments are evaluated, so that a paren vector among them is a value."""

_FORM_OPTIONS = {
    "observe": frozenset({"sigma", "covariance", "information", "bound", "when"}),
    "unknowns": frozenset({"init", "sigma", "covariance"}),
    "states": frozenset({"init", "sigma", "covariance"}),
}
"""Options of a clause (or of its entries) whose value is an expression."""


def literal_vectors(forms: tuple[Form, ...]) -> frozenset[int]:
    """The offsets of the lists inside `problem` forms that are vectors beyond doubt: they begin with a number and stand
    where an expression is evaluated. Everything else is left out: pairs such as ``:in (lo hi)``, rows of tables,
    quoted forms, arguments of names that the file or another one defines.
    """
    redefined = frozenset(
        item.name for form in forms if isinstance(form, Sequence) for item in form.items[:2] if isinstance(item, Symbol)
    )
    search = _Search(EVALUATING - redefined)
    for form in forms:
        if isinstance(form, Sequence) and form.head == "problem":
            for clause in form.items[1:]:
                search.clause(clause)
    return frozenset(search.found)


class _Search:
    """Walks the clauses of a problem; ``found`` collects offsets."""

    def __init__(self, evaluating: frozenset[str]) -> None:
        self.evaluating = evaluating
        self.found: set[int] = set()

    def clause(self, form: Form) -> None:
        """One clause of a problem."""
        if not isinstance(form, Sequence):
            return
        match form.head:
            case "observe":
                self._options(form, "observe")
                for item in _positional(form.items[1:]):
                    self.expression(item)
            case "unknowns" | "states":
                for entry in form.items[1:]:
                    if isinstance(entry, Sequence):
                        self._options(entry, str(form.head))
            case "derive" | "define":
                for entry in form.items[1:]:
                    if isinstance(entry, Sequence) and len(entry.items) > 1:
                        self.expression(entry.items[1])
            case "constraints":
                for entry in form.items[1:]:
                    self._constraint(entry)

    def _constraint(self, form: Form) -> None:
        if isinstance(form, Sequence) and form.head == "for":
            for item in form.items[2:]:
                self._constraint(item)
        else:
            self.call(form)

    def expression(self, form: Form) -> None:
        """A form that is evaluated, and would be a vector if it were a list with a number at its head."""
        if isinstance(form, Sequence) and form.items and isinstance(form.items[0], Numeral):
            if form.bracket is Bracket.ROUND:
                self.found.add(form.span.start)
            for item in form.items:
                self.expression(item)
        else:
            self.call(form)

    def call(self, form: Form) -> None:
        """The arguments of a built-in function, the elements of a vector, the bodies of ``let``."""
        if not isinstance(form, Sequence):
            return
        if form.bracket is Bracket.SQUARE:
            for item in form.items:
                self.expression(item)
        elif form.head in ("let", "let*") and form.head not in self.evaluating and len(form.items) > 1:
            bindings = form.items[1]
            for binding in bindings.items if isinstance(bindings, Sequence) else ():
                if isinstance(binding, Sequence) and len(binding.items) == 2:
                    self.expression(binding.items[1])
            for item in form.items[2:]:
                self.expression(item)
        elif form.head in self.evaluating:
            for item in _positional(form.items[1:]):
                self.expression(item)

    def _options(self, form: Sequence, clause: str) -> None:
        for name, value in zip(form.items, form.items[1:], strict=False):
            if isinstance(name, Keyword) and name.name in _FORM_OPTIONS[clause]:
                self.expression(value)


def _positional(items: tuple[Form, ...]) -> tuple[Form, ...]:
    """The items before the first keyword."""
    first = next((place for place, item in enumerate(items) if isinstance(item, Keyword)), len(items))
    return items[:first]
