"""The photograph beneath an overlay: one file, or those of a folder by their names."""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mbm.files.memory import check_memory
from mbm.files.reading import read_bytes
from mbm.report.view import faults
from mbm.report.view.photographs import Photograph
from mbm.text.faults import shown
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_FILE = 512 * 2**20
"""Bytes of the file of a photograph."""

SHOWN = 2_000
"""Pixels along its longer side to which a photograph is reduced: a panel shows no more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beneath:
    """A photograph: grey or coloured ``pixels`` (h, w) or (h, w, 3), perhaps reduced; its own ``width``, ``height``."""

    pixels: NDArray[np.uint8]
    width: int
    height: int


def beneath(where: Path | None, photograph: Photograph) -> Beneath | None:
    """The photograph at ``where``, a file or a folder of them; None if there is none of this name in the folder.

    Without ``where`` it is that which the data were read from.

    Raises:
        MbmError: bad-photograph, and as `mbm.files.reading.read_bytes` does.

    """
    if where is None:
        return None if photograph.path is None else read_photograph(photograph.path)
    if not where.is_dir():
        return read_photograph(where)
    path = path_in(where, photograph)
    return None if path is None else read_photograph(path)


def path_in(folder: Path, photograph: Photograph) -> Path | None:
    """The file of a photograph in a folder, or the only one of its name before the ending; None if there is none."""
    name = photograph.file or photograph.name
    if not name or Path(name).name != name:
        return None
    path = folder / name
    if path.exists():
        return path
    from PIL import Image

    endings = Image.registered_extensions()
    found = [each for each in folder.iterdir() if each.stem == name and each.suffix.lower() in endings]
    return found[0] if len(found) == 1 else None


def read_photograph(path: Path) -> Beneath:
    """A photograph, of any kind that Pillow reads.

    Raises:
        MbmError: bad-photograph: it is none, is damaged, or has more pixels than Pillow trusts (179 million);
            too-much-memory; and as `mbm.files.reading.read_bytes` does.

    """
    from PIL import Image, UnidentifiedImageError

    place = DataPlace(file=str(path))
    content = read_bytes(path, place, largest=LARGEST_FILE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(BytesIO(content)) as image:
                width, height = image.size
                check_memory(2 * width * height * len(image.getbands()), f"the photograph `{shown(path)}`", place)
                image.draft("RGB", (SHOWN, SHOWN))
                grey = image.mode in ("1", "L", "I;16", "I", "F")
                reduced = image.convert("L" if grey else "RGB")
                reduced.thumbnail((SHOWN, SHOWN))
                return Beneath(pixels=np.asarray(reduced), width=width, height=height)
    except UnidentifiedImageError:  # it would tell the object in memory
        raise MbmError(faults.bad_photograph(str(path), "cannot be read: it is no image of a known kind")) from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise MbmError(faults.bad_photograph(str(path), f"cannot be read: {error}")) from None
