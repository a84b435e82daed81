"""The tables of speed against error, and the lines of README.md that come from it and from the study of the GPU."""
from evidence import origin, plain, repeats, seconds


def scene_title(row):
    title = row["scene"]
    if row["scene"] == "signorini":
        title += f", Q = {row['parameters']['Q']:g}"
    return title


def family(row):
    return row["contestant"].split(" ")[0].split(",")[0]


def fastest(rows, error, members=None):
    """The row with the shortest time among those with an error of y of at most `error`, or None."""
    fit = [
        row
        for row in rows
        if row["status"] == "solved"
        and row["error"]["y"]["max"] is not None
        and row["error"]["y"]["max"] <= error
        and (members is None or family(row) in members)
    ]
    return min(fit, key=lambda row: row["seconds"]["median"], default=None)


def time_and_steps(row):
    if row is None:
        return "not reached"
    time = row["seconds"]
    return f"{seconds(time['median'])} ({seconds(time['min'])} to {seconds(time['max'])}), {row['steps']} steps"


def speed_vs_error(data):
    scenes = by_scene(data)
    lines = ["| scene | error of y | march | contour | implicit Euler | Euler / fastest |", "|--" * 6 + "|"]
    for title, rows in scenes.items():
        for error in targets:
            best = fastest(rows, error)
            if best is None:
                continue
            march, contour, euler = (fastest(rows, error, {name}) for name in ("march", "contour", "euler"))
            ratio = plain(euler["seconds"]["median"] / best["seconds"]["median"]) if euler else "-"
            cells = [title, f"{error:.0e}", *map(time_and_steps, (march, contour, euler)), ratio]
            lines.append("| " + " | ".join(cells) + " |")
    known = {scene_title(rows[0]): rows[0] for rows in scenes.values()}
    sources = "; ".join(
        f"{title}: {row['reference']}"
        + (f", known to {row['reference_known_to']['y']['max']:.0e}" if row["reference_known_to"]["y"]["max"] else "")
        for title, row in known.items()
    )
    return lines + [
        "",
        "Each cell is the fastest run of the ladder, on one thread or on all, whose largest error of y over t >= T/16 is at most "
        f"the error of its line. References: {sources}. {repeats(data)} (minimum to maximum).",
    ]


targets = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def by_scene(data):
    scenes = {}
    for row in data["rows"]:
        scenes.setdefault(scene_title(row), []).append(row)
    return scenes


def lost(data):
    """The cases that the methods of the project lose."""
    euler_wins, iteration_loses, ratios, literal = [], [], [], []
    for title, rows in by_scene(data).items():
        for error in targets:
            march, contour, euler, printed = (
                fastest(rows, error, {name}) for name in ("march", "contour", "euler", "contour-literal")
            )
            time = {name: row["seconds"]["median"] if row else float("inf") for name, row in
                    (("march", march), ("contour", contour), ("euler", euler), ("printed", printed))}  # fmt: skip
            if euler and time["euler"] < min(time["march"], time["contour"]):
                other = min((row for row in (march, contour) if row), key=lambda row: row["seconds"]["median"], default=None)
                beside = f", {other['contestant']} {seconds(other['seconds']['median'])}" if other else ", nothing else gets there"
                euler_wins.append(f"{title} at {error:.0e} ({seconds(time['euler'])}{beside})")
            if euler and contour and time["euler"] < time["contour"]:
                iteration_loses.append(f"{title} at {error:.0e} ({time['contour'] / time['euler']:.3g} times slower)")
            if march and contour:
                ratios.append((time["contour"] / time["march"], f"{title} at {error:.0e}"))
            if printed and march:
                literal.append((time["printed"] / time["march"], f"{title} at {error:.0e}"))
    lines = []
    if euler_wins:
        lines.append("- Implicit Euler is the fastest at: " + "; ".join(euler_wins) + ".")
    else:
        lines.append("- Implicit Euler is the fastest nowhere in this table.")
    if iteration_loses:
        lines.append("- `contour` is slower than implicit Euler at: " + "; ".join(iteration_loses) + ".")
    for name, found in (("contour", ratios), ("contour-literal", literal)):
        slower = sorted(pair for pair in found if pair[0] > 1)
        if slower:
            faster = len(found) - len(slower)
            lines.append(
                f"- `{name}` is slower than `march` in {len(slower)} of {len(found)} cases, by {slower[0][0]:.3g} ({slower[0][1]}) to "
                f"{slower[-1][0]:.3g} times ({slower[-1][1]})" + (f"; it is faster in {faster}." if faster else ".")
            )
    return lines


def not_solved(data):
    """The runs that end without a solution, and why."""
    failures = {}
    for title, rows in by_scene(data).items():
        for row in rows:
            if row["status"] != "solved":
                what = f"{row['literal_nodes'] + 1} nodes" if row["contestant"].endswith("nodes") else f"{row['steps']} steps"
                place = failures.setdefault((title, row["contestant"], row["status"]), {})
                place[what] = row["reason"]
    return [f"- {title}, `{name}`: {status} with {', '.join(places)} ({next(iter(places.values()))})."
            for (title, name, status), places in failures.items()]


def times_faster(ratio):
    return f"{plain(ratio)} times"


def headline(data):
    """What the README says of the small Signorini scene."""
    rows = [row for row in data["rows"] if row["scene"] == "signorini" and row["parameters"]["Q"] == 39]
    best, euler, contour = (fastest(rows, 1e-5, names) for names in (None, {"euler"}, {"contour"}))
    ratio = euler["seconds"]["median"] / best["seconds"]["median"]
    return [
        f"- On two cores, to an error of 1e-05 in y, with 39 points on the membrane, the fastest whole solve is that of `{family(best)}`, "
        f"step by step, in **{seconds(best['seconds']['median'])}**. The iteration takes **{times_faster(contour['seconds']['median'] / best['seconds']['median'])}** "
        f"as long, our own implicit Euler **{times_faster(ratio)}** ({origin(data)}).",
    ]


def headline_gpu(data):
    """The largest grid of the paper's text on a GPU."""
    printed = min((row for row in data["rows"] if row["part"] == "paper, Fig. 4.10"), key=lambda row: row["dx"])
    Q = round(1 / printed["dx"]) - 1
    rows = {row["contestant"]: row for row in data["rows"] if row["part"] == "solve" and (row["Q"], row["steps"]) == (Q, 400)}
    sweeps = rows["contour to (4.8), cuda"]
    return [
        f"- On one {data['parameters']['device']} the iteration of Wu and Chen, with {Q} points and 400 steps, takes **{seconds(sweeps['seconds']['median'])}** "
        f"to their tolerance, with an error of {sweeps['error_max']:.1e} in y; they print {printed['iteration_seconds'] / 3600:.1f} h on a graphics card of 2012, and no error. "
        f"`march` takes **{seconds(rows['march, cuda']['seconds']['median'])}** on that GPU and **{seconds(rows['march, cpu, one core']['seconds']['median'])}** on one core of its host ({origin(data)})."
    ]
