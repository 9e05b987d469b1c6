"""Names of the problem → names that C and Python take, each once: only here a `Foreign` becomes a name or a file.
Names that generated text has for itself, and that its languages have.

A name that is wanted is free if all *forms* are that generated text makes of it: ``result.a`` and ``result.a_sigma``
are two members of a struct. What stands before the point is where they must differ.
"""

from __future__ import annotations

import keyword
import re
import unicodedata

from mbm.emit.foreign import Foreign

_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while main data
result workspace inputs outputs rows row status cost dof sigma0 covariance iterations evaluations coordinates acos asin
atan atan2 ceil cos cosh erf exp expm1 fabs floor fmax fmin fmod gamma hypot j0 j1 jn log log1p pow remainder sin sinh
sqrt tan tanh y0 y1 yn tables constants numbers solve point sigmas free freedom robust_cost np math sys os"""
_WORDS_OF_CPP = """alignas alignof and and_eq asm bitand bitor bool catch char8_t char16_t char32_t class co_await
co_return co_yield compl concept const_cast consteval constexpr constinit decltype delete dynamic_cast explicit
export false friend mutable namespace new noexcept not not_eq nullptr operator or or_eq private protected public
reinterpret_cast requires static_assert static_cast template this thread_local throw true try typeid typename using
virtual wchar_t xor xor_eq"""
RESERVED = frozenset((*_WORDS.split(), *_WORDS_OF_CPP.split()))
"""Words that C, C++ (which may include the header), Python or the printed text itself use."""

_MACROS = """BUFSIZ CHAR_BIT CHAR_MAX CHAR_MIN EOF EXIT_FAILURE EXIT_SUCCESS FILENAME_MAX FOPEN_MAX FP_FAST_FMA
FP_FAST_FMAF FP_FAST_FMAL FP_ILOGB0 FP_ILOGBNAN FP_INFINITE FP_NAN FP_NORMAL FP_SUBNORMAL FP_ZERO HUGE_VAL HUGE_VALF
HUGE_VALL INFINITY INT_MAX INT_MIN LLONG_MAX LLONG_MIN LONG_MAX LONG_MIN L_tmpnam MATH_ERREXCEPT MATH_ERRNO MB_CUR_MAX
MB_LEN_MAX NAN NULL RAND_MAX SCHAR_MAX SCHAR_MIN SEEK_CUR SEEK_END SEEK_SET SHRT_MAX SHRT_MIN TMP_MAX UCHAR_MAX UINT_MAX
ULLONG_MAX ULONG_MAX USHRT_MAX math_errhandling stderr stdin stdout"""
MACROS = frozenset(_MACROS.split())
"""Macros of the headers of C99 that generated text includes: no name of any kind can be one of them."""

_FUNCTIONS = """add_noise add_slopes all_rows by_rows evaluate_rows append_rows eliminate_noise find_rows finish_solve
fused_rows group_noise kept_rows know_rows least_of_minima least_of_paths least_of_windows limit_by_noise load_noise
load_rows penalise_slopes penalise_values put_covariance root_of_covariance root_slopes root_values separate_rows
set_covariance set_rotation_slopes set_slopes set_sphere_slopes singular_values start_solve tried_noise
weights_of_covariance whiten_slopes whiten_values"""
_FRAME = """agreement chosen column consensus columns columns_used constants coordinates covariance data data_numbers
data_set firsts fixed form index index_used kappa known lower members multipliers offsets parameters
parameters_used point results rules scratch sides sigma spare start startless states system
triangle units upper used weights weights_used wide work"""
_RESULT = """ambiguous coordinates cost covariance evaluations free freedom inliers inside iterations numbers point
robust_cost settled sigma0 sigmas status units"""
_DEVICES = "aux com1 com2 com3 com4 con lpt1 lpt2 lpt3 lpt4 nul prn"
_KERNELS = f"{_DEVICES} derived hess jac null residuals"
_PROBLEMS = f"""all build clean csv data edit_cache help install main makefile package package_source preinstall
rebuild_cache test {_DEVICES}"""
_PLACES = (
    ("problem", _PROBLEMS), ("function", _FUNCTIONS), ("frame", _FRAME), ("result", _RESULT), ("kernel", _KERNELS),
    ("table", _DEVICES),
)  # fmt: skip
TAKEN = frozenset(f"{place}.{name}" for place, names in _PLACES for name in names.split())
"""Forms (see `mbm.emit.identifiers`) that generated text has in any case: functions that the name of a clause or of the
problem could become, members of its structs; files, programs and targets of `make` and CMake. Some systems, and CasADi,
do not have some of the files."""

_IN_FILTERS = (
    ("function", "answer_at begin_all close_frame find_rows give keep_derived open_frame put_fixed"),
    ("function", "take_rows take_step take_transition"),
    ("frame", "chain count data dt given keys memory moves moves_count previous rows spread walk"),
    ("result", "at hypotheses innovation residuals"),
    ("data", "at"),
)
TAKEN_IN_FILTERS = TAKEN.union(f"{place}.{name}" for place, names in _IN_FILTERS for name in names.split())
"""The same of generated filters."""

_CALLS = """solve begin residual_count residuals jacobian covariance workspace_size status_text data result workspace
read_tables free_columns free_tables next_key select"""
PROBLEM_FORMS = ("problem.{lower}", *(f"function.{{name}}_{word}" for word in _CALLS.split()))
"""What generated text makes of the name of a problem."""
TABLE_FORMS = (
    "table.{lower}", "data.{name}_rows", "frame.kept_of_{name}", "frame.kept_of_{name}_count", "frame.first_of_{name}",
    "frame.last_of_{name}",
)  # fmt: skip
LINK_FORMS = ("frame.{name}",)
FAMILY_FORMS = ("frame.{name}", "frame.{name}_count")
UNKNOWN_FORMS = (
    "result.{name}", "result.{name}_sigma", "result.{name}_members", "result.{name}_rows", "data.start_{name}",
    "function.set_up_{name}",
)  # fmt: skip
DERIVED_FORMS = (
    "result.{name}", "result.{name}_sigma", "result.{name}_rows", "frame.derived_{name}", "frame.derived_{name}_sigma",
    "frame.derived_{name}_count", "function.derive_{name}",
)  # fmt: skip
CONSTANT_FORM = "function.constant_{name}"
CASE_FORMS = (
    "kernel.{lower}", "function.{name}_values", "function.{name}_slopes", "function.{name}_jacobian",
    "function.{name}_noise", "function.{name}_assemble",
)  # fmt: skip
DERIVED_CASE_FORMS = ("kernel.{lower}", "function.{name}_derived", "function.{name}_assemble")
_STEPS = "filter rows given step finish steps in_order next_step windows window"
FILTER_FORMS = (
    *PROBLEM_FORMS,
    *(f"function.{{name}}_{word}" for word in _STEPS.split()),
)
FILTER_DERIVED_FORMS = (*DERIVED_FORMS, "result.{name}_covariance", "function.keep_{name}")
FILTER_CASE_FORMS = (*CASE_FORMS, "function.{name}_begin", "function.{name}_take")
"""Those of filters."""


LONGEST = 100
"""Characters of a name: file systems take twice as many, with what is added."""


class Identifiers:
    """Gives out names, each once; local to one blueprint."""

    def __init__(self, taken: frozenset[str] = frozenset()) -> None:
        """``taken`` are forms."""
        self._taken = set(taken)

    def made(self, name: Foreign | str, *forms: str, words: frozenset[str] = RESERVED) -> str:
        """A name like ``name`` that is none of ``words`` and whose ``forms`` nobody has yet.

        Forms have ``{name}``, or the same in small or capital letters: ``{lower}``, ``{upper}``.
        """
        wanted = identifier(name)
        found, number = wanted, 1
        while keyword.iskeyword(found) or found in words or not self._free(made := _forms(found, forms or ("{name}",))):
            found = f"{wanted}_" if number == 1 else f"{wanted}_{number}"
            number += 1
        self._taken |= made
        return found

    def _free(self, forms: set[str]) -> bool:
        return self._taken.isdisjoint(forms) and MACROS.isdisjoint(form.rpartition(".")[2] for form in forms)


def _forms(name: str, forms: tuple[str, ...]) -> set[str]:
    return {form.format(name=name, lower=name.lower(), upper=name.upper()) for form in forms}


def identifier(name: Foreign | str) -> str:
    """Letters of other alphabets by their names (``σ`` → ``sigma``), what is no letter or digit as ``_``."""
    parts = []
    for character in name.unescaped if isinstance(name, Foreign) else name:
        if character.isascii():
            parts.append(character if character.isalnum() else "_")
            continue
        words = unicodedata.name(character, "").lower().split()
        parts.append(re.sub(r"\W", "_", words[-1]) if "letter" in words else "_")
    joined = re.sub(r"_+", "_", "".join(parts))[:LONGEST].strip("_") or "unnamed"
    return f"n{joined}" if joined[0].isdigit() else joined
