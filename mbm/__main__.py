"""The program ``mbm``, and ``python -m mbm``.

What Python looks for first in the folder that it is called from, it would import from there: a stranger's problem may
lie there, with files of any name. So that folder is forgotten before anything else is imported.
"""

import os
import sys

if __name__ == "__main__" and not sys.flags.safe_path and sys.path[:1] == [os.getcwd()]:  # noqa: PTH109 - loads much
    del sys.path[0]

from mbm.cli.process import process

if __name__ == "__main__":
    process()
