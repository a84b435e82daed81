"""``python -m bromwich`` and ``bromwich``: the command line."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def main() -> None:
    command = Path(__file__).with_name("bin") / "bromwich"
    if not command.exists():
        sys.exit(f"bromwich: {command} is missing: this build of the package has no command")
    sys.stdout.flush()
    os.execv(command, ["bromwich", *sys.argv[1:]])


if __name__ == "__main__":
    main()
