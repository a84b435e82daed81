"""The tables of what results are worth: tolerances, hard cases, random scenes, coverage."""
from evidence import machine, number, seconds


def tol(data):
    """The results of each scene, each at the smallest tolerance that it meets, and what they are worth."""
    lines = ["| scene | method | tolerance | steps | work | of | estimate | error | ratio | x: estimate | error | ratio | status |"]
    lines.append("|--" * 13 + "|")
    rows = [row for row in data["rows"] if row["status"] != "infeasible"]
    for row, after in zip(rows, rows[1:] + [None]):
        same = after and all(row[key] == after[key] for key in ("scene", "method_asked", "steps", "status"))
        if same:
            continue
        ratio = [f"{row['effectivity'][of]:.2f}" if row["effectivity"][of] is not None else "-" for of in ("y", "x")]
        lines.append(
            f"| {row['scene']} | {row['method']} | {row['tolerance']:.0e} | {row['steps']} | {row['work']} | {row['of']} | "
            f"{number(row['estimate']['y'])} | {number(row['error']['y'])} | {ratio[0]} | "
            f"{number(row['estimate']['x'])} | {number(row['error']['x'])} | {ratio[1]} | {row['status']} |"
        )
    return lines + ["", *tol_share(data)]


def tol_share(data):
    """How many estimates are near the true error."""
    share = data["details"]["share"]
    found = "".join(
        f" Of {of} in {share[of]['good']} of {share[of]['results']} results"
        + (f", in all results of {share[of]['good_scenes']} of {share[of]['scenes']} scenes" if "scenes" in share[of] else "")
        + f". The smallest is {share[of]['smallest']:.2f}, the largest {share[of]['largest']:.3g}."
        for of in ("y", "x")
    )
    return [f"Estimate over true error between 0.5 and 3:{found} {machine(data)}."]


def stability(data):
    """Every hard case: what was said, how far it is from the truth, and implicit Euler on the same number of steps."""
    heads = ["case", "m", "n", "status", "steps", "error of x", "error of y", "estimate", "time", "Euler: x", "y"]
    beside = any("siconos" in row for row in data["rows"])
    heads += ["time", "Siconos: x", "y", "time"] if beside else []
    lines = ["| " + " | ".join(heads) + " |", "|--" * len(heads) + "|"]

    def time_of(run):
        taken = run["seconds"] and run["seconds"]["median"]
        return "" if taken is None else seconds(taken)

    for row in data["rows"]:
        status = row["status"] if row["verdict"] in ("right", "missed") else f"**{row['status']}**" if row["verdict"] == "wrong" else row["status"]
        y = number(row["error_y"]) + (" (∫y)" if row["error_y"] is not None and row["of"] != "y" else "")
        cells = [row["case"], str(row["states"]), str(row["constraints"]), status, str(row["steps"]), number(row["error_x"]), y,
                 number(row["estimate"]), time_of(row), number(row["euler"]["error_x"]), number(row["euler"]["error_y"])]
        if beside:
            peer = row.get("siconos")
            shown = peer and peer["status"] == "solved"
            cells += [time_of(row["euler"])]
            cells += [number(peer["error_x"]), number(peer["error_y"]), time_of(peer)] if shown else [peer["reason"] if peer else "", "", ""]
        lines.append("| " + " | ".join(cells) + " |")
    counts = ", ".join(f"{count} {name}" for name, count in data["details"]["counts"].items())
    return lines + ["", f"Tolerance {data['rows'][0]['tolerance']:.0e}: {counts}. {machine(data)}."]


def random(data):
    methods = data["all"]
    lines = ["| method | " + " | ".join(methods) + " |", "|--" * (len(methods) + 1) + "|"]
    for label, key in (
        ("solved", "solved"),
        ("infeasible", "infeasible"),
        ("tolerance_not_met", "tolerance_not_met"),
        ("unsupported", "unsupported"),
        ("nonfinite", "nonfinite"),
        ("of these not solved though the discrete problem has a solution", "missed"),
        ("**not what the status says**", "silent_failures"),
    ):
        counts = ["-" if key == "missed" and name == "contour" else str(c.get(key, 0)) for name, c in methods.items()]
        lines.append(f"| {label} | " + " | ".join(counts) + " |")
    return lines + [
        "",
        f"{data['count']} random scenes of all classes and spectra (up to 6 states and constraints, coarse grids, units from 1e-6 to "
        "1e6). An independent dense oracle judged each step of every result called solved, and every `infeasible` (`bromwich_random_scenes`).",
    ]


def trust(data):
    """What became of random scenes with every kind of source."""
    columns = (("all", data["verdicts"]), ("breakpoints named", data["told"]), ("not named", data["not_told"]))
    lines = ["| verdict | " + " | ".join(name for name, _ in columns) + " |", "|--" * (len(columns) + 1) + "|"]
    meanings = (
        ("right", "error below the tolerance"),
        ("missed", "solved, error up to 3 times the tolerance"),
        ("wrong", "**solved, error above that**"),
        ("refused", "refused though well-conditioned"),
        ("ill-conditioned", "refused, and data changed by 1e-10 move the solution"),
        ("undecided", "not decided by the oracle"),
    )
    for key, label in meanings:
        lines.append(f"| {label} | " + " | ".join(str(counts.get(key, 0)) for _, counts in columns) + " |")
    counts = data["verdicts"]
    decided = sum(counts.get(key, 0) for key in ("right", "missed", "wrong", "refused"))
    quantiles = ", ".join(f"{name} {value:.2g}" for name, value in data["effectivity"].items())
    return lines + [
        "",
        f"{data['count']} scenes from seed {data['first_seed']} on, `--tol {data['tolerance']:.0e}`, method {data['method']}, {data['seconds']:.0f} s "
        f"each at most. Refused: {100 * counts.get('refused', 0) / decided:.1f} % of the well-conditioned ones; their reasons are in the file. "
        f"Estimate over error: {quantiles}; between 0.3 and 3 for {100 * data['effectivity_in_0.3_to_3']:.0f} %. Commit {data['commit'][:9]}.",
    ]


def engineering(data):
    """Random circuits, masses and tanks: what became of them, and what was refused or stopped."""
    verdicts = ("right", "missed", "wrong", "refused", "slow", "none", "undecided")
    lines = ["| scenes | " + " | ".join(verdicts) + " | longest |", "|--" * (len(verdicts) + 2) + "|"]
    for name, of in data["classes"].items():
        label = name.removesuffix(", original")
        counts = [str(of["verdicts"].get(verdict, 0)) for verdict in verdicts]
        lines.append(f"| {label} | " + " | ".join(counts) + f" | {seconds(of['most_seconds'])} |")
    return lines + [
        "",
        f"Seeds from {data['first_seed']} on, `--tol {data['tolerance']:.0e}`, method {data['method']}, CPU time of one thread, {data['most_seconds']:.0f} s each at "
        f"most, {data['jobs']} at once on a machine with other work. What was lost, and why, is in the file. {machine(data)}.",
    ]


def given_steps(data):
    """What given steps of random scenes are worth, and what is said of them, by method."""
    lines = [
        "| method | steps | refused | off by more than 6 % | without a word | in x | right to 2 % | with a notice | estimate of x good | of y |",
        "|--" * 10 + "|",
    ]
    for run in data["runs"]:
        verdicts, c = run["verdicts"], run["certificates"]
        lines.append(
            f"| {run['method']} | {run['steps']} | {verdicts.get('refused', 0)} | {verdicts.get('wrong', 0)} | {run['silent']['all']} | "
            f"{run['silent']['in_x']} | {verdicts['right']} | {run['right_with_warning']} | {100 * c['x_in_0.3_to_3']:.1f} % of {c['x_compared']} | "
            f"{100 * c['y_in_0.3_to_3']:.1f} % of {c['y_compared']} |"
        )
    first = data["runs"][0]
    decided = first["count"] - first["verdicts"]["undecided"]
    return lines + [
        "",
        f"{decided} scenes of {first['count']} from seed {first['first_seed']} on that the oracle decides. A good estimate is between 0.3 and 3 times "
        f"the error. Commit {first['commit'][:9]}.",
    ]


def coverage(data):
    lines = ["| folder | lines | covered |", "|--|--|--|"]
    for folder, count in data["folders"].items():
        lines.append(f"| {folder} | {count['lines']} | {100 * count['covered'] / count['lines']:.1f} % |")
    return lines + ["", f"All tests, commit {data['commit'][:9]}, {data['compiler']}."]
