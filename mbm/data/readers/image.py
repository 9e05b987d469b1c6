"""``(image "spot.png")``: the grey values of an image, a row for each pixel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbm.data.cells import frozen
from mbm.data.images.header import EXTENSIONS
from mbm.data.images.photographs import named, part_of, read_image, table_of
from mbm.data.types import ImageReader, RawTable
from mbm.problem.tables import Column, Format

PER_ROW = 72
"""Bytes for a pixel: three columns of numbers, two of texts, its row in the file, and room to make them."""


def read(paths: Mapping[str, Path], shown: str, arguments: Mapping[str, float | str]) -> RawTable:
    """All pixels of all images, row by row; ``grey`` from 0 to 255.

    Raises MbmError as `read_image` does.
    """
    del arguments  # there are none
    found = {name: read_image(path, PER_ROW * len(paths)) for name, path in paths.items()}
    sizes = [image.shape for image, _ in found.values()]
    places = [np.mgrid[:height, :width].reshape(2, -1).astype(np.float64) for height, width in sizes]
    down, across = np.concatenate(places, axis=1)
    grey = np.concatenate([image.ravel() for image, _ in found.values()]).astype(np.float64)
    columns = [*named(shown, ((name, paths[name].as_posix(), image.size) for name, (image, _) in found.items()))]
    for name, values in (("u", across), ("v", down), ("grey", grey)):
        columns.append(Column(name=name, numbers=frozen(values)))
    parts = [
        part_of(paths[name].as_posix(), digest, image.size, (image.shape[1], image.shape[0]))
        for name, (image, digest) in found.items()
    ]
    return table_of(shown, columns, parts)


READER = ImageReader(name="image", extensions=EXTENSIONS, format=Format(units={"u": "px", "v": "px"}), read=read)
