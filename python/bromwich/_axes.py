"""Labels of axes: names with units, and numbers in thousands of the unit."""

from __future__ import annotations

from typing import Any

import numpy as np

# Units that take prefixes. Others, such as mm, h and degrees, stay as they are.
WITH_PREFIX = frozenset("s V A W m g Hz F H N J C K Pa T Wb mol rad Ω ohm".split())
PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
# Sizes that are read without a prefix.
PLAIN = (0.1, 1e4)


def scale_of(values: np.ndarray, unit: str) -> tuple[float, str]:
    """The number of units that is one on the axis, and the unit with its prefix: 1e-6 and µs."""
    finite = np.abs(values[np.isfinite(values)])
    size = float(finite.max()) if finite.size else 0.0
    if unit not in WITH_PREFIX or size == 0 or PLAIN[0] <= size < PLAIN[1]:
        return 1.0, unit
    power = 3 * int(np.floor(np.log10(size) / 3))
    if power not in PREFIXES:
        return 1.0, unit
    return 10.0**power, PREFIXES[power] + unit


def label(axis: Any, name: str, unit: str, values: np.ndarray) -> None:
    """Names an axis of Matplotlib and writes its numbers in that unit. The data stay as they are."""
    from matplotlib.ticker import FuncFormatter

    scale, named = scale_of(values, unit)
    if scale != 1.0:
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v / scale:.6g}"))
    axis.set_label_text(f"{name} [{named}]" if named else name)
