"""Makes raw tables from files, one format per file; ``READERS`` lists the formats by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.data.readers import bal, csv, euroc, g2o, json, kitti, npz, parquet, tsv, tum
from mbm.data.types import ManyReader, Reader

_MODULES = (csv, tsv, json, npz, parquet, tum, kitti, euroc, bal, g2o)

READERS: Mapping[str, Reader | ManyReader] = MappingProxyType(
    {module.READER.name: module.READER for module in _MODULES}
)
