"""``python -m bromwich`` and ``bromwich``: the command line."""

from __future__ import annotations

import os
import signal
import sys

from . import _core, _hdf5_file


def main() -> None:
    sys.stdout.flush()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the command handles Ctrl-C itself
    code = _core.command(["bromwich", *sys.argv[1:]])
    if _hdf5_file.HdfFile.failed:  # HDF5 would end the process by a signal when it closes such a file
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    main()
