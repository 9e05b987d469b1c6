"""Joint samples as files of others: NumPy's, Parquet, and arviz' InferenceData."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from mbm.data.writers import write_npz
from mbm.problem.tables import Column
from mbm.report import faults
from mbm.report.propagation.solve import PropagatedSolve
from mbm.text.faults import missing_extra
from mbm.text.types import MbmError

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
