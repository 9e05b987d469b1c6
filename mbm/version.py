"""The version of mbm, as result documents and ``mbm --version`` state it; `pyproject.toml` states the same."""

__version__ = "0.1.0"
