"""The targets by name."""

from __future__ import annotations

from mbm.emit.types import Blueprint, OutputFile, Target


def files_of(blueprint: Blueprint, target: Target) -> tuple[OutputFile, ...]:
    """All files of a generated solver, in the order of their paths; each target is loaded when it is asked for."""
    if target is Target.C:
        from mbm.emit.c.files import c_files

        made = c_files(blueprint)
    elif target is Target.PYTHON:
        from mbm.emit.python.files import python_files

        made = python_files(blueprint)
    else:
        from mbm.emit.casadi.files import casadi_files

        made = casadi_files(blueprint)
    return tuple(sorted(made, key=lambda file: file.path))
