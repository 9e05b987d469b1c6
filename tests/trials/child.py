"""``python -m mbm`` as it is, in a process that tells what it touches: run by `tests.trials.processes`.

Its first argument says in JSON what is watched and bounded; those after it are mbm's.
"""

from __future__ import annotations

import json
import os
import resource
import runpy
import sys
from functools import partial
from pathlib import Path
from typing import NoReturn

from tests.trials.watching import begin

STATUS = Path("/proc/self/status")


def tell(stream: int, what: str) -> None:
    """One thing that should not have happened; written at once, for mbm ends its process without looking back."""
    os.write(stream, what.encode("utf-8", "backslashreplace").replace(b"\n", b" ") + b"\n")


def measure(stream: int) -> None:
    """Has what the system says of this program written when mbm ends its process, where it says anything."""
    leave = os._exit

    def told(status: int) -> NoReturn:
        if STATUS.exists():
            os.write(stream, STATUS.read_bytes())
        leave(status)

    os._exit = told


def main() -> None:
    """Sets the bounds, begins to watch, and becomes mbm."""
    asked = json.loads(sys.argv[1])
    for bound, most in ((resource.RLIMIT_AS, asked["space"]), (resource.RLIMIT_CPU, asked["seconds"])):
        resource.setrlimit(bound, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    measure(os.open(asked["measured"], os.O_WRONLY))
    stream = os.open(asked["heard"], os.O_WRONLY | os.O_APPEND)
    begin(Path(asked["folder"]), asked["devices"], map(Path, asked["closed"]), partial(tell, stream))
    sys.argv = ["mbm", *sys.argv[2:]]
    runpy.run_module("mbm", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
