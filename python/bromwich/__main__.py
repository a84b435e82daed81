"""``python -m bromwich`` and ``bromwich``: the command line."""

from __future__ import annotations

import signal
import sys

from . import _core


def main() -> None:
    sys.stdout.flush()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the command handles Ctrl-C itself
    sys.exit(_core.command(["bromwich", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
