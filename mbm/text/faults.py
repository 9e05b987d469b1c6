"""What can be wrong with a text: the codes of this stage, and one constructor for each kind of diagnostic."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mbm.text.shown import cut
from mbm.text.types import Code, DataPlace, Diagnostic, Label, Place, Severity, Span

UNCLOSED_BRACKET = Code(
    "unclosed-bracket",
    "A `(` or `[` has no closing partner before the text, or the top-level form it stands in, ends.",
    "Write the closing bracket; the message shows where the layout suggests it was forgotten.",
)
SURPLUS_BRACKET = Code(
    "surplus-bracket",
    "A `)` or `]` closes nothing: every bracket before it is closed already.",
    "Remove it, or look for an opening bracket that is missing before it.",
)
MISMATCHED_BRACKET = Code(
    "mismatched-bracket",
    "A `(` is closed by `]`, or a `[` by `)`.",
    "Lists are `( … )`, literal vectors `[ … ]`: close each with its own partner.",
)
TOO_DEEPLY_NESTED = Code(
    "too-deeply-nested",
    "Brackets and quotes stand inside one another deeper than the reader follows.",
    "Name an inner part by `let`, `define` or `defun` and use the name.",
)
BAD_NUMBER = Code(
    "bad-number",
    "What starts with [sign][point]digit is a number or a quantity, and this is neither.",
    "Write numbers as `12`, `-3.5`, `2.5e-3` or `1/3`, with a unit stuck to them: `5mm`, `40deg/s^2`.",
)
ZERO_DENOMINATOR = Code(
    "zero-denominator",
    "A fraction is written with 0 below the line.",
    "Write the number that is meant; infinity has no spelling, leave the bound out instead.",
)
NUMBER_OUT_OF_RANGE = Code(
    "number-out-of-range",
    "A number is too large, too close to zero, or has too many digits to be computed with (doubles reach 1.8e308).",
    "Check the exponent; choose a unit in which the number is of ordinary size.",
)
UNTERMINATED_STRING = Code(
    "unterminated-string",
    'A string begins with `"` and the text ends before it does.',
    'Write the closing `"`; a quotation mark inside a string is written `\\"`.',
)
UNKNOWN_ESCAPE = Code(
    "unknown-escape",
    "A backslash in a string is followed by a character that has no meaning there.",
    'The escapes are `\\"`, `\\\\`, `\\n` and `\\t`; paths are written with `/` on every system.',
)
UNTERMINATED_COMMENT = Code(
    "unterminated-comment",
    "A block comment `#| … |#` is not closed; block comments nest, so each `#|` needs its `|#`.",
    "Write the missing `|#`.",
)
STRAY_CHARACTER = Code(
    "stray-character",
    "A character stands where none of its kind is read: it can be part of no name, number or bracket.",
    "Remove it. Names consist of letters, digits and `- + * / < > = ! ? _ . % ^ & @`.",
)
UNEXPECTED_COMMA = Code(
    "unexpected-comma",
    "A comma stands outside quasi-quotation; items are separated by spaces, and the decimal sign is the point.",
    "Write a space.",
)
EMPTY_KEYWORD = Code(
    "empty-keyword",
    "A colon has no name behind it.",
    "Write the option's name directly after the colon, as in `:sigma`.",
)
NOTHING_TO_QUOTE = Code(
    "nothing-to-quote",
    "A quote, back-quote or comma is followed by no form.",
    "Write the form that is to be quoted behind it, or remove it.",
)
MORE_FAULTS = Code(
    "more-faults",
    "The text has more faults than are worth printing; only the first are shown.",
    "Mend the ones shown first. If the file is no .mbm file, name the right one.",
)
MISSING_EXTRA = Code(
    "missing-extra",
    "What was asked for needs a library that the core installation leaves out.",
    "Install mbm with the extra that the message names.",
)
NOT_TEXT = Code(
    "not-text",
    "The file is no UTF-8 text: it holds bytes or characters that no text has.",
    "Name the right file, or save it as UTF-8.",
)
TOO_LONG_TO_PRINT = Code(
    "too-long-to-print",
    "A form is too long to be printed: parts that occur in it many times are kept once, but are printed each time.",
    "Print a smaller part of it; what it stands for can be used in a problem nevertheless.",
)
TEXT_TOO_LARGE = Code(
    "text-too-large",
    "The text is larger than a problem file can reasonably be.",
    'Keep measurements in data files and name them: `(data ranges (csv "ranges.csv"))`.',
)

_PARTNER = {"(": ")", "[": "]"}


def unclosed_bracket(opening: Span, noticed: Span | None, others: int) -> Diagnostic:
    """``noticed`` is a form whose place in the layout says that the bracket should be closed before it; ``others``
    counts the further brackets left open.
    """
    bracket = opening.text
    more = f", nor {'is another' if others == 1 else f'are {others} others'} around it" if others else ""
    labels = () if noticed is None else (Label(noticed, f"was `{_PARTNER[bracket]}` forgotten before this?"),)
    return Diagnostic(
        code=UNCLOSED_BRACKET,
        message=f"`{bracket}` is never closed{more}",
        place=opening,
        hint=f"write the missing `{_PARTNER[bracket]}`",
        labels=labels,
    )


def surplus_bracket(closing: Span) -> Diagnostic:
    """A closing bracket while none is open."""
    return Diagnostic(
        code=SURPLUS_BRACKET,
        message=f"`{closing.text}` closes nothing",
        place=closing,
        hint="remove it, or add the opening bracket that is missing before it",
    )


def mismatched_bracket(closing: Span, opening: Span) -> Diagnostic:
    """A closing bracket of the other kind than the innermost open one."""
    return Diagnostic(
        code=MISMATCHED_BRACKET,
        message=f"`{opening.text}` is closed by `{closing.text}`",
        place=closing,
        hint=f"write `{_PARTNER[opening.text]}`",
        labels=(Label(opening, "opened here"),),
    )


def too_deeply_nested(place: Span, limit: int) -> Diagnostic:
    """More than ``limit`` levels of brackets and quotes."""
    return Diagnostic(
        code=TOO_DEEPLY_NESTED,
        message=f"brackets and quotes are nested more than {limit} deep here",
        place=place,
        hint="name an inner part by `let` or `defun`",
    )


LOOKED_BACK = 80
"""Characters before a number in which its keyword is looked for: no file of many faults is read again for each."""


def bad_number(place: Span) -> Diagnostic:
    """``12abc$``, ``3..4``: begins as a number does and is none."""
    written = place.text
    digits = written.rstrip("/").partition("/")
    if digits[1] and not digits[2][:1].isdigit() and _is_plain_number(digits[0]):
        before = place.source.text[max(0, place.start - LOOKED_BACK) : place.start]
        number = "" if before.rstrip().endswith(":unit") else digits[0]
        hint = f"a unit below the line is written `{number}{_above(digits[2])}`"
    else:
        hint = "numbers are `12`, `-3.5`, `2e-3`, `1/3`; quantities `5mm`, `40deg/s^2`"
    return Diagnostic(code=BAD_NUMBER, message=f"`{shown(written)}` is no number", place=place, hint=hint)


def _above(units: str) -> str:
    """``m/s^2``, which divides, as a factor: ``m^-1*s^-2``."""
    factors = (part.partition("*") for part in units.split("/"))
    return "*".join(
        f"{unit}^-{power or 1}{times}{rest}"
        for first, times, rest in factors
        for unit, _, power in [first.partition("^")]
    )


def zero_denominator(place: Span) -> Diagnostic:
    """``1/0``."""
    return Diagnostic(
        code=ZERO_DENOMINATOR,
        message=f"`{shown(place.text)}` divides by zero",
        place=place,
        hint="write a denominator other than 0",
    )


def number_out_of_range(place: Span, problem: str) -> Diagnostic:
    """``problem`` completes the sentence “`1e999` …”."""
    return Diagnostic(
        code=NUMBER_OUT_OF_RANGE,
        message=f"`{shown(place.text)}` {problem}",
        place=place,
        hint="double precision reaches from 5e-324 to 1.8e308",
    )


def sixty_minutes(place: Span) -> Diagnostic:
    """An angle such as ``12d75m``."""
    return Diagnostic(
        code=BAD_NUMBER, message=f"`{shown(place.text)}` has 60 minutes or seconds, or more", place=place,
        hint="carry them: `13d15m` is `12d75m`",
    )  # fmt: skip


def no_finite_number(place: Span) -> Diagnostic:
    """NaN or an infinity among Python values."""
    hint = "leave out what is not known; a cell without a value is the symbol `NA`"
    return Diagnostic(code=BAD_NUMBER, message=f"`{place.text}` is no finite number", place=place, hint=hint)


def unterminated_string(opening: Span, earlier: Span | None) -> Diagnostic:
    """``earlier`` is a string before this one that runs over several lines, perhaps the true culprit."""
    labels = () if earlier is None else (Label(earlier, 'or was the closing `"` of this one forgotten?'),)
    return Diagnostic(
        code=UNTERMINATED_STRING, message="this string has no end", place=opening,
        hint='write the closing `"`',
        labels=labels,
    )  # fmt: skip


def unknown_escape(place: Span) -> Diagnostic:
    """A backslash before a letter that is no escape."""
    return Diagnostic(
        code=UNKNOWN_ESCAPE,
        message=f"`{shown(place.text)}` means nothing in a string",
        place=place,
        hint='the escapes are `\\"`, `\\\\`, `\\n`, `\\t`; write paths with `/`',
    )


def unterminated_comment(opening: Span) -> Diagnostic:
    """A ``#|`` that is not closed."""
    return Diagnostic(
        code=UNTERMINATED_COMMENT,
        message="this comment has no end",
        place=opening,
        hint="write the closing `|#`; block comments nest",
    )


def stray_character(place: Span) -> Diagnostic:
    """A character (the first of ``place``) that no token has."""
    character = place.text[0]
    hints = {
        "{": "lists are written `( … )`, vectors `[ … ]`",
        "}": "lists are written `( … )`, vectors `[ … ]`",
        "#": "comments are `; …` and `#| … |#`",
        "|": "comments are `; …` and `#| … |#`",
        ":": "a keyword is `:` and a name, after a space: `:sigma`",
    }
    named = f"`{character}`" if character.isprintable() else "this invisible character"
    return Diagnostic(
        code=STRAY_CHARACTER,
        message=f"{named} (U+{ord(character):04X}) has no meaning here",
        place=place,
        hint=hints.get(character, "remove it"),
    )


def unexpected_comma(place: Span) -> Diagnostic:
    """A comma outside quasi-quotation."""
    return Diagnostic(
        code=UNEXPECTED_COMMA,
        message="a comma has a meaning inside back-quoted forms only",
        place=place,
        hint="write a space (or, in a number, a decimal point)",
    )


def empty_keyword(place: Span) -> Diagnostic:
    """A colon without a name."""
    return Diagnostic(
        code=EMPTY_KEYWORD,
        message=f"`{shown(place.text)}` names no option",
        place=place,
        hint="write the name directly after the colon, as in `:sigma`",
    )


def nothing_to_quote(place: Span) -> Diagnostic:
    """A quote before a closing bracket or the end of the text."""
    return Diagnostic(
        code=NOTHING_TO_QUOTE,
        message=f"nothing follows this `{place.text}`",
        place=place,
        hint="write the form to be quoted behind it, or remove it",
    )


MOST_FAULTS = 30
"""Diagnostics of one kind, errors or warnings, that are worth a reader's time."""


def worth_reading(found: Sequence[Diagnostic], *, ended: bool = False) -> tuple[Diagnostic, ...]:
    """The first ``MOST_FAULTS`` of the diagnostics, and one that says how many more there are.

    ``ended``: looking for faults ended after these, so that nobody knows how many more there are.
    """
    if len(found) <= MOST_FAULTS:
        return tuple(found)
    first = found[MOST_FAULTS]
    count = len(found) - MOST_FAULTS
    what = "warning" if first.severity is Severity.WARNING else "fault"
    message = f"{count} more {what if count == 1 else f'{what}s'} from here on"
    if ended:
        message = f"after {MOST_FAULTS} {what}s the rest is not looked at"
    hint = "mend the ones above first"
    rest = Diagnostic(code=MORE_FAULTS, message=message, place=first.place, hint=hint, severity=first.severity)
    return (*found[:MOST_FAULTS], rest)


def not_text(name: str, what: str, place: Place) -> Diagnostic:
    """``what`` was found at ``place`` in the text ``name``."""
    return Diagnostic(
        code=NOT_TEXT,
        message=f"`{shown(name)}` is no UTF-8 text: it holds {what}",
        place=place,
        hint="name the right file, or save it as UTF-8",
    )


def missing_extra(what: str, extra: str, place: Place | None = None) -> Diagnostic:
    """``what`` needs the optional dependencies ``extra``."""
    return Diagnostic(
        code=MISSING_EXTRA,
        message=f"{what} needs libraries that are not installed",
        place=place,
        hint=f'install them with `pip install "mbm[{extra}]"`',
    )


def too_long_to_print(place: Place, limit: int) -> Diagnostic:
    """More than ``limit`` characters."""
    return Diagnostic(
        code=TOO_LONG_TO_PRINT,
        message=f"this stands for a form of more than {limit:,} characters, too long to be printed",
        place=place,
        hint="print a smaller part of it",
    )


def text_too_large(name: str, limit: int, place: Place | None = None) -> Diagnostic:
    """More than ``limit`` characters (of a file: bytes)."""
    return Diagnostic(
        code=TEXT_TOO_LARGE,
        message=f"`{shown(name)}` is larger than {limit // 2**20} MiB",
        place=DataPlace(file=name) if place is None else place,
        hint="keep measurements in data files and name them in a `data` clause",
    )


def too_many_words_in_all(place: Span, limit: int) -> Diagnostic:
    """``place`` begins the file with which all files together have more words than the ``limit``."""
    return Diagnostic(
        code=TEXT_TOO_LARGE,
        message=f"with this file, the problem and what it uses have more than {limit:,} names, numbers and brackets",
        place=place,
        hint="use fewer files, or keep measurements in data files",
    )


def too_long_in_all(place: Span, limit: int) -> Diagnostic:
    """``place`` begins the file with which all files together have more characters than the ``limit``."""
    return Diagnostic(
        code=TEXT_TOO_LARGE,
        message=f"with this file, the problem and what it uses are larger than {limit // 2**20} MiB",
        place=place,
        hint="use fewer files, or keep measurements in data files",
    )


def too_many_words(place: Span, limit: int) -> Diagnostic:
    """``place`` is the first word beyond the ``limit``."""
    return Diagnostic(
        code=TEXT_TOO_LARGE,
        message=f"the text goes on after {limit:,} names, numbers and brackets, which is as far as it is read",
        place=place,
        hint="keep measurements in data files and name them in a `data` clause",
    )


REASON_LENGTH = 200
"""Characters that are told of an exception of code that is not mbm's."""


def shown(words: str | Path, longest: int = 60) -> str:
    """Words of a user as a message shows them: on one line, printable, and not endless."""
    return cut(str(words), longest)


def _is_plain_number(written: str) -> bool:
    return written.lstrip("+-").replace(".", "", 1).isdigit()
