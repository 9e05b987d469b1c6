"""What ``mbm propagate`` answers: the result of the solve, what the trials say of each
quantity, its table, and the samples as files of others (NumPy's, Parquet, arviz' InferenceData).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from math import floor, log10
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from mbm.data.writers import write_npz
from mbm.problem.naming import key_words
from mbm.problem.tables import Column
from mbm.report import faults
from mbm.report.columns import Pad, aligned, laid_out, left, wrapped
from mbm.report.digits import measured, plain
from mbm.report.document import document
from mbm.report.elements import unit_text
from mbm.report.intervals import MOST_LINES
from mbm.report.pickled import as_data
from mbm.report.propagation.solve import TOO_FEW, Part, PropagatedSolve, Propagation, propagation_document
from mbm.report.sentences import diagnostic_sentence
from mbm.report.types import Result, ResultStatus
from mbm.text.faults import missing_extra
from mbm.text.shown import Paint, Style, joined
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propagated:
    """A propagation of distributions: ``result`` is that of the solve, ``solves`` have the trials of each.

    ``places`` are the numbers (from 0) of the solves in the result: those that are not to be trusted have no trials.
    A propagation of one solve answers for it: ``found["q"]``, ``found.trials``.
    """

    result: Result
    solves: tuple[PropagatedSolve, ...]
    places: tuple[int, ...]

    @property
    def status(self) -> ResultStatus:
        """That of the solve."""
        return self.result.status

    @property
    def only(self) -> PropagatedSolve:
        """The trials of the only solve.

        Raises:
            LookupError: there are several.

        """
        if len(self.solves) != 1:
            raise LookupError(f"there are {len(self.solves)} solves: the trials of each are in `.solves`")
        return self.solves[0]

    @property
    def trials(self) -> int:
        """All trials of the only solve."""
        return self.only.trials

    def __getitem__(self, name: str) -> Propagation:
        """What the trials of the only solve say of a quantity; errors as for ``only``, and KeyError."""
        return self.only[name]

    def __iter__(self) -> Iterator[str]:
        """The names of the estimates, then of the derived quantities."""
        return iter(self.only)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The warnings of all trials."""
        return tuple(each for solve in self.solves for each in solve.diagnostics)

    def document(self) -> dict[str, Any]:
        """The result document, each solve with its ``propagation``."""
        found = document(self.result)
        own = dict(zip(self.places, self.solves, strict=True))
        for place, written in enumerate(found["solves"]):
            written["propagation"] = propagation_document(own[place]) if place in own else None
        return found

    def samples(self) -> dict[str, Any]:
        """The joint samples: the cells of the keys, if there are any, then the scalars by name; arrays (T,)."""
        return sample_columns(self.solves)

    def save(self, path: str | Path) -> None:
        """Write the joint samples: ``.npz``, ``.parquet`` (needs pyarrow) or ``.nc`` (needs arviz).

        Raises:
            MbmError: `sample-format`, `missing-extra`, `not-writable`, `would-overwrite`.

        """
        from mbm.files.writing import write_whole

        write_whole(path, sample_format(str(path))(self.solves), reads=self.result.reads)

    def to_arviz(self) -> Any:
        """The samples of the only solve as ``arviz.InferenceData``: one chain, a variable for each quantity.

        Raises:
            MbmError: `missing-extra`, arviz is not installed.

        """
        return inference_data(self.only)

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as data, as results do."""
        kept = as_data(self.result)
        pairs = zip(self.places, self.solves, strict=True)
        solves = tuple(each.of(kept.solves[place]) for place, each in pairs)
        return partial(type(self), result=kept, solves=solves, places=self.places), ()

    def __str__(self) -> str:
        return self.table()

    def table(self, *, width: int = 100, color: bool = False, full: bool = False) -> str:
        """The table of the command line, with a line break at the end; ``full`` shows all scalars."""
        return table(self.result, self.solves, width=width, color=color, full=full)


Writer: TypeAlias = Callable[[Sequence[PropagatedSolve]], bytes]
"""Writes the samples of solves in one format."""


def sample_columns(solves: Sequence[PropagatedSolve]) -> dict[str, Any]:
    """The joint samples: the cells of the keys, if there are any, then the scalars by name; arrays (T,).

    A key that is called as a scalar is ``key.NAME``.
    """
    counts = [len(each.sampled.samples) for each in solves]
    names = dict.fromkeys(name for each in solves for name in each.names)
    found: dict[str, Any] = {
        f"key.{name}" if name in names else name: np.repeat(np.array([each.solve.key[name] for each in solves]), counts)
        for name in (solves[0].solve.key if solves else ())
    }
    for name in names:
        parts = [
            each.sampled.samples[:, each.names.index(name)] if name in each.names else np.full(count, np.nan)
            for each, count in zip(solves, counts, strict=True)
        ]
        found[name] = np.concatenate(parts)
    return found


def sample_format(path: str) -> Writer:
    """What writes the format that the ending of a path names.

    Raises:
        MbmError: `sample-format`, there is none.

    """
    ending = PurePath(path).suffix.lower()
    if ending not in FORMATS:
        raise MbmError(faults.sample_format(path, tuple(FORMATS)))
    return FORMATS[ending]


def inference_data(found: PropagatedSolve) -> Any:
    """The samples of a solve as ``arviz.InferenceData``: one chain, a variable for each quantity.

    Raises:
        MbmError: `missing-extra`.

    """
    try:
        with warnings.catch_warnings():  # it announces its next version
            warnings.simplefilter("ignore")
            from arviz import from_dict
    except ImportError as error:
        raise MbmError(missing_extra("InferenceData", "samples")) from error
    return from_dict(posterior={name: found[name].samples[None] for name in found})


def _npz(found: Sequence[PropagatedSolve]) -> bytes:
    """Arrays by the names of the scalars; the cells of keys as texts or numbers."""
    return write_npz([_column(name, values) for name, values in sample_columns(found).items()])


def _column(name: str, values: np.ndarray) -> Column:
    if values.dtype.kind == "U":
        return Column(name=name, texts=tuple(values.tolist()))
    return Column(name=name, numbers=values)


def _parquet(found: Sequence[PropagatedSolve]) -> bytes:
    try:
        from pyarrow import BufferOutputStream, table
        from pyarrow.parquet import write_table
    except ImportError as error:
        raise MbmError(missing_extra("Parquet", "tables")) from error
    target = BufferOutputStream()
    write_table(table(sample_columns(found)), target)
    return bytes(target.getvalue().to_pybytes())


def _netcdf(found: Sequence[PropagatedSolve]) -> bytes:
    if len(found) != 1:
        raise MbmError(faults.several_sampled(len(found)))
    made = inference_data(found[0])
    with TemporaryDirectory() as folder:  # its writers take paths only
        path = Path(folder) / "samples.nc"
        try:
            made.to_netcdf(str(path))
        except (ImportError, ValueError) as error:
            raise MbmError(missing_extra("NetCDF", "samples")) from error
        return path.read_bytes()


FORMATS: Mapping[str, Writer] = MappingProxyType({".npz": _npz, ".parquet": _parquet, ".nc": _netcdf})
"""By the endings of files."""


HEAD = ("", "mean", "sigma", "interval", "shortest", "linear")
ALIGNED: tuple[Pad, ...] = (left, *(lambda column: left([column[0], *aligned(column[1:])]),) * 4, left)


def table(
    result: Result, solves: Sequence[PropagatedSolve], *, width: int, color: bool = False, full: bool = False
) -> str:
    """The table, with a line break at the end; ``full`` shows all scalars."""
    paint = Paint(color)
    where = f"{result.file}: " if result.file else ""
    lines = [paint(f"{where}problem `{result.problem}`", Style.HEADING)]
    for each in solves:
        lines += ["", *_of_solve(each, width, paint, full)]
    return joined((line.rstrip() for line in lines), color=color) + "\n"


def _of_solve(found: PropagatedSolve, width: int, paint: Paint, full: bool) -> Iterator[str]:
    key = key_words(found.solve.key)
    level = f"{plain(100 * found.solve.coverage, 6)} %"
    yield f"{key + ': ' if key else ''}{found.trials:,} trials, {level} intervals"
    yield ""
    rows = list(chain.from_iterable(_rows(found, part) for part in found.parts))
    shown = rows if full else rows[:MOST_LINES]
    for number, (name, *cells) in enumerate(laid_out([HEAD, *shown] if shown else [], ALIGNED)):
        yield "  " + "  ".join([paint(name, Style.HEADING) if number else name, *cells])
    if len(rows) > len(shown):
        yield paint("  … and more (-v shows all)", Style.QUIET)
    for diagnostic in found.diagnostics:
        yield from (paint(line, Style.WARNING) for line in wrapped(diagnostic_sentence(diagnostic), width))


def _rows(found: PropagatedSolve, part: Part) -> Iterator[tuple[str, ...]]:
    """Name, mean, sigma, intervals, and what the linear one says, of each scalar of a part."""
    told, agrees, compared = found.sampled.spreads, found.agrees(part), found.compared(part)
    unit = unit_text(part.item.quantity)
    for k, name in enumerate(part.names):
        place = part.columns.start + k
        missing, varies = int(found.sampled.undefined[place]), bool(found.sampled.varies[place])
        if missing == len(found.sampled.samples):
            yield name, "undefined", "", "", "", part.item.reason or "it has no finite value"
            continue
        sigma = float(told.sigma[place])
        scale = sigma if varies else float(np.diff(told.interval[place])[0]) / 4.0
        mean = _number(float(told.mean[place] if varies else told.median[place]), scale)
        ends = [_interval(told.interval[place], scale), _interval(told.shortest[place], scale)]
        middle = mean if varies else f"{mean} (median)"
        verdict = {None: TOO_FEW, True: "agrees", False: "differs"}[agrees[k]] if compared[k] else ""
        linear = f"{_interval(part.linear[k], scale)} {verdict}" if verdict else "none"
        linear += f"; no value in {missing:,} trials" if missing else ""
        yield name, f"{middle} {unit}".rstrip(), _sigma(sigma) if varies else "none", *ends, linear


def _interval(ends: np.ndarray, scale: float) -> str:
    return f"{_number(float(ends[0]), scale)} … {_number(float(ends[1]), scale)}"


def _number(value: float, sigma: float) -> str:
    """A number with the digits of its standard deviation; a very large or small one with its own power of ten."""
    text = measured(value, sigma).value if sigma > 0.0 else plain(value, 6)
    if not text.startswith("("):
        return text
    return plain(value, max(2, 2 + floor(log10(abs(value) / sigma))) if value else 1)


def _sigma(sigma: float) -> str:
    text = measured(0.0, sigma).sigma
    return plain(sigma, 2) if text.endswith(")") or "e" in text else text
