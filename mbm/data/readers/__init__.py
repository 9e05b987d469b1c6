"""Makes raw tables from files, one format per file; ``READERS`` lists the formats by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.data.readers import csv, json, npz, tsv
from mbm.data.types import Reader

READERS: Mapping[str, Reader] = MappingProxyType(
    {module.READER.name: module.READER for module in (csv, tsv, json, npz)},
)
