"""What the scripts that draw pictures share: the style, the colours, panels, and legends beside the curves."""
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import evidence

plt.style.use(evidence.root / "scripts" / "style.mplstyle")
NAVY, RED, TEAL, AMBER, BLACK, GREY, SKY = plt.rcParams["axes.prop_cycle"].by_key()["color"]

# One colour and marker a method, in every picture.
styles = {
    "contour": (NAVY, "o", "contour: all time points at once"),
    "contour (paper's tolerance)": (SKY, "o", "contour, to the paper's tolerance"),
    "contour-literal": (GREY, "v", "contour-literal: the paper to the letter"),
    "multigrid": (AMBER, "D", "multigrid in time"),
    "march": (TEAL, "P", "march: exponential, step by step"),
    "march (modal)": (BLACK, "s", "march, all eigenvalues"),
    "march (compressed)": (TEAL, "s", "march, compressed exponentials"),
    "euler": (RED, "X", "implicit Euler"),
}
MOST_PANELS = 4


def panels(rows, columns, size):
    """A figure of rows x columns panels, at most four: more do not fit a page."""
    if rows * columns > MOST_PANELS:
        raise ValueError(f"{rows} x {columns} panels; a picture has {MOST_PANELS} at most")
    return plt.subplots(rows, columns, figsize=size, squeeze=False)


def describe(axes, title, xlabel, ylabel):
    axes.set(title=title, xlabel=xlabel, ylabel=ylabel)


def plain_ticks(axis, values):
    """Ticks 1, 2, 5 times powers of ten in plain numbers, for a logarithmic axis of less than two decades."""
    low, high = min(values), max(values)
    ticks = [d * 10**e for e in range(9) for d in (1, 2, 5) if low <= d * 10**e <= high]
    axis.set_ticks(ticks, [f"{tick}" for tick in ticks])
    axis.set_ticks([], minor=True)


def legend_below(figure, columns=3):
    """One legend for all panels, below them: every label once, in the order of the panels."""
    entries = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)


def legend_below_panel(axes, columns=2):
    """A legend of one panel, below it."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=columns)
