"""Tables of bench/results/paper.json: what the paper claims beside what bromwich measures. `paper(data)` gives lines of
markdown."""
from evidence import machine, number, seconds


def rows_of(data, figure, **wanted):
    """Rows of one figure; numbers are compared to nine digits."""

    def fits(row):
        for key, value in wanted.items():
            found = row.get(key)
            same = abs(found / value - 1) < 1e-9 if isinstance(value, float) else found == value
            if not same:
                return False
        return True

    return [row for row in data["rows"] if row["figure"] == figure and fits(row)]


def fraction(value):
    return f"1/{1 / value:.0f}"


def listed(rows, key, at):
    return ", ".join(f"{row[key]} ({fraction(row[at])})" for row in rows)


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|--" * len(head) + "|"] + ["| " + " | ".join(row) + " |" for row in rows]


def note(data, *starts):
    """The conclusions that the study itself drew."""
    return ["- " + text for text in data["notes"] if text.startswith(starts)]


# Claims


def rates_in_h(data):
    large = rows_of(data, "4.6 left")
    small = rows_of(data, "4.1")
    return (
        f"{listed(large, 'sweeps_to_1e-12', 'h')} sweeps to 1e-12 (signorini, dx = 1/25); "
        f"{listed(small, 'sweeps_to_1e-12', 'h')} (our dlcp-small)"
    )


def rates_in_dx(data):
    rows = rows_of(data, "4.6 right")
    return f"{listed(rows, 'sweeps_to_tolerance', 'dx')} sweeps to (4.8)"


def bound(data):
    row = rows_of(data, "4.1")[-1]
    above = max(10**b / e for b, e in zip(row["bound_log10"][:12], row["error_x"][:12]))
    return (
        f"with phi = {row['bound_phi']:.2g}, L = {row['bound_lipschitz']:.3g} it stays above the error of the start for "
        f"{row['bound_useful_from']:.2g} sweeps, where {row['sweeps_to_1e-12']} are enough; within 12 sweeps it is up to {above:.0e} times too large"
    )


def order_in_h(data):
    text = [text for text in data["notes"] if text.startswith("Fig. 4.3 left, contour-literal")]
    return text[0].split(": ", 1)[1].replace(" (the paper: O(h), bound 5h)", "") if text else "-"


def rate_in_nodes(data):
    text = [text for text in data["notes"] if text.startswith("Fig. 4.3 right")]
    return text[0].split(": ", 1)[1] if text else "-"


def euler_breaks(data):
    parts = []
    for name, T in (("dlcp-small", 1.0), ("dlcp-small, unstable variant", 1.0), ("dlcp-small, unstable variant", 0.125)):
        rows = rows_of(data, "4.4", scene=name, T=T)
        if not rows:
            continue
        counts = []
        for method in ("euler", "contour", "march"):
            right = []
            for z_matrix in (False, True):
                of = [row for row in rows if row["method"] == method and row["z_matrix"] == z_matrix]
                right.append(f"{sum(row['useful'] for row in of)} of {len(of)}")
            counts.append(f"{method} {right[0]} and {right[1]}")
        parts.append(f"{name}, T = {T:g}: {', '.join(counts)}")
    return "usable results at steps whose M^h is no Z-matrix, and at those where it is one: " + "; ".join(parts)


def claims(data):
    rows = [
        ("4.1, 4.6 left", "the rate is 'strongly robust' in h", rates_in_h(data)),
        ("4.1", "the bound of Theorem 2.2 'predicts the measured convergence rate very well'", bound(data)),
        ("4.3 left", "O(h), below 5h", order_in_h(data)),
        ("4.3 right", "e^{-2.06 √P}/√P", rate_in_nodes(data)),
        ("4.4", "Euler finds no solution at h = 2^-6, where M^h is no Z-matrix; the iteration is not affected", euler_breaks(data)),
        ("4.6 right", "the count 'somehow slightly increases' as dx decreases", rates_in_dx(data)),
    ]
    return table(("figure", "the paper", "measured"), rows)


# Times


def time_cell(row):
    time = row["seconds"]
    return f"{seconds(time['median'])} ({seconds(time['min'])} to {seconds(time['max'])})"


def ratio(value):
    digits = float(f"{value:.2g}")
    return f"{digits:,.0f}".replace(",", " ") if digits >= 10 else f"{digits:g}"


def quoted_times(data):
    lines = []
    for quoted in rows_of(data, "4.10", status="quoted"):
        for ours in rows_of(data, "4.10", h=quoted["h"], dx=quoted["dx"], status="solved"):
            if (quoted["contestant"] == "paper: euler") != (ours["contestant"] == "euler"):
                continue
            times = quoted["seconds"]["median"]
            lines.append(
                (
                    f"h = {quoted['h']:g}, dx = {fraction(quoted['dx'])}",
                    f"{quoted['contestant'].removeprefix('paper: ')}, {quoted['machine']}: {quoted['words']}".replace("'", ""),
                    ours["contestant"],
                    time_cell(ours),
                    ratio(times / ours["seconds"]["median"]),
                    number(ours["error_y"]),
                )
            )
    return table(("point", "the paper", "here", "time", "ratio", "error of y"), lines)


def all_times(data):
    lines = []
    for fixed, across in (({"dx": 0.025}, "h"), ({"h": 0.01}, "dx")):
        rows = [row for row in rows_of(data, "4.10", **fixed) if row["status"] == "solved"]
        for value in sorted({row[across] for row in rows}, reverse=True):
            if across == "dx" and abs(value / 0.025 - 1) < 1e-9:
                continue  # in the first half already
            cells = {row["contestant"]: row for row in rows if row[across] == value}
            contour = cells.get("contour, to (4.8)")
            errors = " / ".join(number(cells[name]["error_y"]) for name in ("contour, to (4.8)", "march", "euler") if name in cells)
            lines.append(
                [fraction(cells["march"]["h"]), fraction(cells["march"]["dx"]), str(contour["sweeps"]) if contour else "-"]
                + [seconds(cells[name]["seconds"]["median"]) if name in cells else "-" for name in ("contour, to (4.8)", "march", "euler", "contour-literal, to (4.8)")]
                + [errors]
            )
    return table(("h", "dx", "sweeps", "contour, to (4.8)", "march", "Euler", "contour-literal", "error of y: contour / march / Euler"), lines)


def split(data):
    parts = ("lcp", "convolution", "transform", "setup", "other")
    lines = []
    for row in rows_of(data, "4.10", contestant="contour, to (4.8)", h=0.01):
        if row["split_percent"]:
            lines.append([fraction(row["dx"])] + [f"{row['split_percent'][part]:.0f} %" for part in parts])
    lines.sort(key=lambda line: float(line[0].split("/")[1]))
    return table(("dx (h = 1/100)", "LCP", "convolution", "sine transform", "set-up", "other"), lines)


def references(data):
    """How much finer the grids of the references are, and how well those are known."""
    rows = rows_of(data, "4.10", contestant="march")
    finer = [int(row["reference"].split()[2]) // row["steps"] for row in rows]
    known = max(row["reference_known_to_y"] for row in rows)
    return f"march on a grid {min(finer)} to {max(finer)} times finer, which half its steps change by {number(known)} at most"


def paper(data):
    return [
        *claims(data),
        "",
        "dlcp-small has the paper's matrices and a prescribed solution, because the printed sources admit none; the paper's own "
        "counts for it cannot be repeated.",
        "",
        *note(data, "Fig. 4.1,", "Fig. 4.4", "Fig. 4.6", "Nodes"),
        "",
        *quoted_times(data),
        "",
        *note(data, "Hardware", "The paper's text quotes", "Equal steps"),
        "",
        *all_times(data),
        "",
        *note(data, "Fig. 4.10: contour"),
        "",
        *split(data),
        "",
        f"{machine(data)}, median of {data['repeats']} interleaved repeats (minimum to maximum). Errors of y over t >= T/16 "
        f"against {references(data)}.",
    ]
