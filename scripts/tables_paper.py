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


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|--" * len(head) + "|"] + ["| " + " | ".join(row) + " |" for row in rows]


def note(data, *starts):
    """The conclusions that the study itself drew."""
    return ["- " + text for text in data["notes"] if text.startswith(starts)]


# Claims


def rates_in_h(data, figure, at):
    rows = rows_of(data, figure)
    counts = {row["sweeps_to_1e-12"] for row in rows}
    steps = ", ".join(fraction(row["h"]) for row in rows)
    if len(counts) == 1:
        return f"{at}: {counts.pop()} sweeps to 1e-12 at each of h = {steps}"
    return f"{at}: {', '.join(str(row['sweeps_to_1e-12']) for row in rows)} sweeps to 1e-12 at h = {steps}"


def rates_in_dx(data):
    rows = sorted(rows_of(data, "4.6 right"), key=lambda row: -row["dx"])
    return f"from {rows[0]['sweeps_to_tolerance']} sweeps to (4.8) at dx = {fraction(rows[0]['dx'])} to {rows[-1]['sweeps_to_tolerance']} at {fraction(rows[-1]['dx'])}; see below"


def sweeps_in_dx(data):
    rows = sorted(rows_of(data, "4.6 right"), key=lambda row: -row["dx"])
    quoted = rows_of(data, "4.6 right", dx=0.025)[0]
    fifth = quoted["error_y"][quoted["sweeps"].index(5)]
    return [
        *table(("Fig. 4.6 right, dx (h = 1/100)", *(fraction(row["dx"]) for row in rows)), [("sweeps to (4.8)", *(str(row["sweeps_to_tolerance"]) for row in rows))]),
        "",
        f"- The paper's text quotes 5 sweeps at dx = 1/40: there y errs by {number(fifth)}; (4.8) asks for {number(quoted['tolerance'])}",
    ]


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


def robustness(data):
    """Fig. 4.4: at how many steps each method gives a usable result, where M^h is a Z-matrix and where it is not."""
    lines = []
    for name, T in (("dlcp-small", 1.0), ("dlcp-small, unstable variant", 1.0), ("dlcp-small, unstable variant", 0.125)):
        rows = rows_of(data, "4.4", scene=name, T=T)
        for method in ("euler", "contour", "march") if rows else ():
            of = {z: [row for row in rows if row["method"] == method and row["z_matrix"] == z] for z in (False, True)}
            lines.append((f"{name}, T = {T:g}", method, *(f"{sum(row['useful'] for row in of[z])} of {len(of[z])}" for z in (False, True))))
    return table(("Fig. 4.4", "method", "usable where M^h is no Z-matrix", "usable where it is one"), lines)


def slower(data):
    """Fig. 4.10: contour beside march, in one line."""
    ratios = []
    for row in rows_of(data, "4.10", contestant="contour, to (4.8)", status="solved"):
        march = rows_of(data, "4.10", contestant="march", h=row["h"], dx=row["dx"], status="solved")
        ratios += [row["seconds"]["median"] / march[0]["seconds"]["median"]] if march else []
    lost = [ratio for ratio in ratios if ratio > 1]
    return f"- Fig. 4.10: contour to (4.8) is slower than march at {len(lost)} of {len(ratios)} points, by {min(lost):.2f} to {max(lost):.2f}"


def claims(data):
    rows = [
        ("4.1", "the rate is 'strongly robust' in h", rates_in_h(data, "4.1", "our dlcp-small")),
        ("4.6 left", "the same", rates_in_h(data, "4.6 left", "signorini, dx = 1/25")),
        ("4.1", "the bound of Theorem 2.2 'predicts the measured convergence rate very well'", bound(data)),
        ("4.3 left", "O(h), below 5h", order_in_h(data)),
        ("4.3 right", "e^{-2.06 √P}/√P", rate_in_nodes(data)),
        ("4.4", "Euler finds no solution at h = 2^-6, where M^h is no Z-matrix; the iteration is not affected", "see the table of Fig. 4.4 below"),
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


def times(data):
    """The times that the paper's text gives, and ours."""
    return [*quoted_times(data), "", *note(data, "Equal steps"), slower(data), "", f"{machine(data)}."]


def paper(data):
    return [
        *claims(data),
        "",
        "dlcp-small has the paper's matrices and a prescribed solution, because the printed sources admit none; the paper's own "
        "counts for it cannot be repeated.",
        "",
        *note(data, "Fig. 4.1,", "Nodes"),
        "",
        *robustness(data),
        "",
        *note(data, "Fig. 4.4"),
        "",
        *sweeps_in_dx(data),
        "",
        *quoted_times(data),
        "",
        *note(data, "Hardware", "The paper's text quotes", "Equal steps"),
        "",
        *all_times(data),
        "",
        slower(data),
        "",
        *split(data),
        "",
        f"{machine(data)}, median of {data['repeats']} interleaved repeats (minimum to maximum). Errors of y over t >= T/16 "
        f"against {references(data)}.",
    ]
