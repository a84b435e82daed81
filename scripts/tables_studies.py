"""The tables of README and docs that come from studies of `bromwich bench`: each takes the measurements and gives lines
of markdown."""
from evidence import machine, number, seconds


def repeats(data):
    return f"{machine(data)}, median of {data['repeats']} interleaved repeats"


def plain(ratio):
    """Three digits without an exponent."""
    return f"{ratio:.3g}" if ratio < 1000 else f"{float(f'{ratio:.3g}'):.0f}"


# Speed against error


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
        f"the error of its line. Errors against: {sources}. {repeats(data)} (minimum to maximum).",
    ]


targets = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def by_scene(data):
    scenes = {}
    for row in data["rows"]:
        scenes.setdefault(scene_title(row), []).append(row)
    return scenes


def lost(data):
    """The cases that the methods of the project lose, or do not solve."""
    euler_wins, iteration_loses, ratios, literal, failures = [], [], [], [], {}
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
        for row in rows:
            if row["status"] != "solved":
                what = f"{row['literal_nodes'] + 1} nodes" if row["contestant"].endswith("nodes") else f"{row['steps']} steps"
                place = failures.setdefault((title, row["contestant"], row["status"]), {})
                place[what] = row["reason"]
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
    for (title, name, status), places in failures.items():
        reason = next(iter(places.values()))
        lines.append(f"- {title}, `{name}`: {status} with {', '.join(places)} ({reason}).")
    return lines


def times_faster(ratio):
    return f"{plain(ratio)} times"


def origin(data):
    return f"commit {data['commit'][:9]}"


def headline(data):
    """What the README says of the small Signorini scene."""
    rows = [row for row in data["rows"] if row["scene"] == "signorini" and row["parameters"]["Q"] == 39]
    best, euler = fastest(rows, 1e-5), fastest(rows, 1e-5, {"euler"})
    ratio = euler["seconds"]["median"] / best["seconds"]["median"]
    return [
        f"- To an error of 1e-05 in y, with 39 points on the membrane, a whole solve takes **{seconds(best['seconds']['median'])}** on two cores, "
        f"and our own implicit Euler, as fast as we could make it, takes **{times_faster(ratio)}** as long ({origin(data)}).",
    ]


def headline_gpu(data):
    """The largest grid of the paper's text on a GPU."""
    printed = min((row for row in data["rows"] if row["part"] == "paper, Fig. 4.10"), key=lambda row: row["dx"])
    Q = round(1 / printed["dx"]) - 1
    rows = {row["contestant"]: row for row in data["rows"] if row["part"] == "solve" and (row["Q"], row["steps"]) == (Q, 400)}
    sweeps = rows["contour to (4.8), cuda"]
    return [
        f"- On one {data['parameters']['device']} the iteration of Wu and Chen with {Q} points and 400 steps takes **{seconds(sweeps['seconds']['median'])}** "
        f"to their tolerance, where they print {printed['iteration_seconds'] / 3600:.1f} h for their code on a graphics card of 2012 ({origin(data)})."
    ]


# The other studies


def baselines(data):
    lines = ["| Q | method | steps | sweeps | error of y, max | time |", "|--|--|--|--|--|--|"]
    for row in data["rows"]:
        if row["status"] != "solved":
            continue
        time = row["seconds"]
        lines.append(
            f"| {row['parameters']['Q']:g} | {row['contestant']} | {row['steps']} | {row['iterations']} | "
            f"{row['error_max']:.1e} | {seconds(time['median'])} ({seconds(time['min'])} to {seconds(time['max'])}) |"
        )
    lines += [""] + ["- " + note for note in data["notes"] if "equal error" in note]
    return lines + ["", f"Error against {data['rows'][0]['reference']}, t >= T/16. {repeats(data)} (minimum to maximum)."]


def convolution(data):
    cells = {}
    for row in data["rows"]:
        key = (row["parameters"]["Q"], row["steps"])
        cells.setdefault(key, {})[row["contestant"]] = row["seconds"]["median"]
    lines = ["| Q | J | scan of exponentials | FFT |", "|--|--|--|--|"]
    for (Q, steps), cell in cells.items():
        lines.append(f"| {Q:g} | {steps} | {seconds(cell['scan'])} | {seconds(cell['fft'])} |")
    return lines + ["", f"One application of K * y in modes. {repeats(data)}."]


def solver(data):
    with_f = all("again_with_f" in row for row in data["rows"])
    lines = [f"| scene | backend | J | method | whole solve | its cycles or steps | again | set-up of it |{' again with f |' if with_f else ''} "
             "difference |", "|--" * (10 if with_f else 9) + "|"]  # fmt: skip
    for row in data["rows"]:
        Q = row["parameters"].get("Q")
        name = row["scene"] + (f", Q = {Q:g}" if Q else "")
        again = row["again"]
        other_f = f" {seconds(row['again_with_f']['median'])} |" if with_f else ""
        lines.append(
            f"| {name} | {row['backend']} | {row['steps']} | {row['method']} | {seconds(row['whole']['median'])} | "
            f"{seconds(row['whole']['solve'])} | {seconds(again['median'])} | {seconds(again['setup'])} |{other_f} {row['difference']:.1e} |"
        )
    other = "; with f: another x0 and f" if with_f else ""
    return lines + ["", f"Again: the same scene with another x0 by a `Solver`, whose first solve has prepared it{other}. Its time includes handing x0 over. "
                    f"Difference: of y from that of the whole solve, relative to the largest. {repeats(data)}."]  # fmt: skip


def multigrid(data):
    lines = ["| backend | dx | J | contraction | cycles to 1e-12 | cycles that are useful | algebraic error | discretisation error | "
             "in fine sweeps | set-up | solve | plain sweeps to 1e-12 |", "|--" * 12 + "|"]  # fmt: skip
    skipped = []
    for row in sorted(data["rows"], key=lambda row: (row["backend"], row["Q"], row["steps"])):
        if "skipped" in row:
            skipped.append(f"{row['backend']} at dx = 1/{row['Q'] + 1:g}, J = {row['steps']}: {row['skipped']}")
            continue
        useful, counted = row["useful"], row["plain_counted_with_steps"] == row["steps"]
        lines.append(
            f"| {row['backend']} | 1/{row['Q'] + 1:g} | {row['steps']} | {row['contraction']:.3f} | {row['cycles']} | {useful['cycles']} | "
            f"{number(useful['algebraic_error'])} | {number(useful['discretisation_error'])} | {useful['fine_sweep_equivalents']:.1f} | "
            f"{seconds(useful['seconds']['setup'])} | {seconds(useful['seconds']['solve'])} | {'' if counted else '~ '}{row['plain_sweeps']} |"
        )
    lines += [""] + ["- " + note for note in data["notes"]] + ["- not run: " + what for what in skipped]
    return lines + [
        "",
        "Useful: until the algebraic error is estimated below a tenth of the discretisation error; set-up and solve are of that run. "
        "Algebraic error: against the run to 1e-12. Discretisation error: from the differences of the three finest grids. "
        f"~: counted with fewer steps. {repeats(data)}.",
    ]


def signorini3d(data):
    lines = ["| backend | Q | J | method | set-up | solve | cycles | applications of K + passes | residual |", "|--" * 9 + "|"]
    skipped = []
    for row in data["rows"]:
        if "skipped" in row:
            skipped.append(f"{row['backend']} at Q = {row['Q']:g}, J = {row['steps']}, {row['contestant']}: {row['skipped']}")
            continue
        cycled = row["convolutions"] > 0
        work = f"{row['convolutions']:.1f} + {row['passes']:.1f}" if cycled else ""
        lines.append(
            f"| {row['backend']} | {row['Q']:g} | {row['steps']} | {row['contestant']} | {seconds(row['seconds']['setup'])} | {seconds(row['seconds']['solve'])} | "
            f"{row['cycles'] if cycled else ''} | {work} | {number(row['residual'])} |"
        )
    return lines + ["- not run: " + what for what in skipped] + [
        "",
        "multigrid: until the algebraic error is estimated below a twentieth of the discretisation error. Solve includes the residual "
        "and the copy of y to the host. Applications and passes are counted on all grids, in units of the finest one. Without cycles: "
        f"too few steps for coarser grids. {machine(data)}, medians.",
    ]


def kernels(data):
    most = 8  # kernels of a size
    lines = ["| Q | kernel | launches | time | share | TB/s | TB/s on the finest grid |", "|--" * 7 + "|"]
    sizes = sorted({(row["Q"], row["steps"]) for row in data["rows"]})
    for size in sizes:
        rows = [row for row in data["rows"] if (row["Q"], row["steps"]) == size]
        whole = sum(row["seconds"] for row in rows)
        for row in rows[:most]:
            lines.append(
                f"| {row['Q']} | `{row['kernel']}` | {row['launches']} | {seconds(row['seconds'])} | {100 * row['seconds'] / whole:.0f} % | "
                f"{row['bytes_per_second'] / 1e12:.2f} | {row['largest_bytes_per_second'] / 1e12:.2f} |"
            )
    steps = ", ".join(f"J = {J} at Q = {Q}" for Q, J in sizes)
    return lines + ["", f"One solve with its set-up, {steps}, by Nsight Compute; the most expensive kernels. {data['parameters']['device']}, "
                    f"{origin(data)}."]


def auto_choices(data):
    lines = ["| scene | J | chosen | its time | fastest | its time | ratio |", "|--" * 7 + "|"]
    cases = {}
    for row in data["rows"]:
        cases.setdefault((row["scene"], str(row["parameters"]), row["steps"]), []).append(row)
    for (scene, _, steps), rows in cases.items():
        chosen = next(row for row in rows if row["method_asked"] == "auto")
        named = [row for row in rows if row["method_asked"] != "auto" and row["ratio"] is not None]
        best = min(named, key=lambda row: row["seconds"]["median"])
        sizes = ", ".join(f"{key} = {value:g}" for key, value in chosen["parameters"].items() if key in ("Q", "m", "n"))
        lines.append(
            f"| {scene}{', ' + sizes if sizes else ''} | {steps} | {chosen['method']}, {chosen['backend']} | {seconds(chosen['seconds']['median'])} | "
            f"{best['method']}, {best['backend']} | {seconds(best['seconds']['median'])} | {chosen['ratio']:.2f} |"
        )
    return lines + ["", *data["notes"], "", f"{repeats(data)}."]


def scenes(data):
    lines = ["| scene | m | n | M | spectrum of A | method | steps | error of x | error of y | status | time |"]
    lines.append("|--" * 11 + "|")
    for row in data["rows"]:
        if row["scene"] == "template":  # rlcd once more
            continue
        status = row["status"]
        if status == "infeasible" and row["infeasible_at"] is not None:
            status += f" at t = {row['infeasible_at']:.4g}"
        if not row["as_expected"]:
            status += " (not as the file says)"
        lines.append(
            f"| [{row['scene']}](../examples/{row['scene']}.toml) | {row['states']} | {row['constraints']} | "
            f"{row['class']} | {row['spectrum']} | {row['method']} | {row['steps']} | "
            f"{number(row['error_x'])} | {number(row['error_y'])} | "
            f"{status} | {seconds(row['seconds']['median'])} |"
        )
    return lines + ["", f"Time: the whole solve without states, median of {data['repeats']} repeats. {machine(data)}."]


def sparse(data):
    lines = ["| states | nonzeros of A | kernel set-up | whole solve | kept, without A | kernel error | difference from the dense solution |"]
    lines.append("|--" * 7 + "|")
    for row in data["rows"]:
        if row["contestant"] != "sparse":
            continue
        difference = number(row["difference_max"]) or "-"
        lines.append(
            f"| {row['states']} | {row['nonzeros']} | {seconds(row['seconds']['setup'])} | "
            f"{seconds(row['seconds']['median'])} | {row['bytes'] / 1e6:.0f} MB | {number(row['kernel_error'])} | {difference} |"
        )
    return lines + [
        "",
        "The dense scene is small enough to step its state, which `march` does with discontinuous y (Radau IIA) at this step: the "
        "difference is that of two discretisations. On one discretisation the tests hold 1e-10.",
        "",
        f"Heat in a square, 10 contact points, {data['rows'][0]['steps']} steps. {machine(data)}.",
    ]


def fields(data):
    """Both contestants with equal steps and at equal error."""
    lines = ["| states | contacts | compliance | at | | steps | by Euler | error of w | mean error of y | set-up | whole solve | min to max | memory |"]
    lines.append("|--" * 13 + "|")
    for row in data["rows"]:
        time, euler = row["seconds"], row["contestant"] == "sparse euler"
        lines.append(
            f"| {row['states']} | {row['constraints']} | {row['parameters']['compliance']:g} | {row['at']} | {row['contestant']} | "
            f"{row['steps']} | {'' if euler else row['euler_steps']} | {number(row['error_w_max'])} | {number(row['error_y_mean'])} | "
            f"{seconds(time['setup'])} | {seconds(time['median'])} | {seconds(time['min'])} to {seconds(time['max'])} | "
            f"{row['bytes'] / 1e6:.0f} MB |"
        )
    worst = max(row["kernel_error"] for row in data["rows"])
    return lines + [""] + [f"- {note}" for note in data["notes"]] + [
        "",
        f"Largest kernel error {number(worst)}. M = 0 counts its shifted solves as solve. {machine(data)}.",
    ]


def scale(data):
    """Time divided among ranks: one measured row, and what the model says of more."""
    lines = ["| ranks | sweep | cycle | efficiency, equal J | efficiency, equal J of a rank | bytes a rank sends in a cycle |", "|--" * 6 + "|"]
    measured = next(row for row in data["rows"] if row["kind"] == "measured")
    for row in data["rows"]:
        if row["kind"] == "predicted":
            lines.append(
                f"| {row['ranks']} | {seconds(row['sweep'])} | {seconds(row['cycle'])} | {row['strong']:.2f} | {row['weak']:.2f} | {number(row['bytes'])} |"
            )
    size = ", ".join(f"{name} = {value:g}" for name, value in data["parameters"].items())
    return lines + [
        "",
        f"`{data['scene']}` with {size}, J = {measured['steps']}; ranks of one thread. Measured: a sweep takes {seconds(measured['sweep_on_one'])} "
        f"on one rank and {seconds(measured['sweep'])} on {measured['ranks']}, efficiency {measured['efficiency']:.2f}; the rest is predicted. {machine(data)}.",
    ]


def fields_peers(data):
    """Each contestant at equal error, then factorizations beside SuiteSparse."""
    lines = ["| states | compliance | | steps | error of w | mean error of y | set-up | whole solve | min to max | times march |"]
    lines.append("|--" * 10 + "|")
    march = 1.0
    for row in data["rows"]:
        time, stopped = row["seconds"], row["status"].startswith("stopped")
        march = time["median"] if row["contestant"] == "bromwich march" else march
        errors = [number(row[name]) if row[name] is not None else "as above" for name in ("error_w_max", "error_y_mean")]
        lines.append(
            f"| {row['states']} | {row['parameters']['compliance']:g} | {row['contestant']} | {row['steps']} | {errors[0]} | "
            f"{errors[1]} | {seconds(time['setup'])} | {'about ' if stopped else ''}{seconds(time['median'])} | "
            f"{seconds(time['min'])} to {seconds(time['max'])} | {time['median'] / march:.1f} |"
        )
    for found in data["factors"]:
        node, eigen, cholmod = found["node"], found["eigen"], found["cholmod"]
        lines += ["", f"- m = {found['states']}, n = {found['constraints']}, one thread: values at a complex node by our elimination "
                  f"{seconds(node['elimination'])}, by UMFPACK {seconds(node['umfpack'])}; a real factorization by Eigen "
                  f"{seconds(eigen['factorization'])}, by CHOLMOD {seconds(cholmod['factorization'])}; one solve {seconds(eigen['solve'])} and "
                  f"{seconds(cholmod['solve'])}."]
    stopped = any(row["status"].startswith("stopped") for row in data["rows"])
    about = "\"About\": PETSc was stopped, and its time is that of all steps at the pace of those done. " if stopped else ""
    return lines + ["", f"{about}{machine(data)}, {data['repeats']} rounds."]


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
    share = data["details"]["share"]
    found = "; ".join(
        f"of {of}: {share[of]['good']} of {share[of]['results']} results"
        + (f", all those of {share[of]['good_scenes']} of {share[of]['scenes']} scenes" if "scenes" in share[of] else "")
        + f", the smallest {share[of]['smallest']:.2f}, "
        f"the largest {share[of]['largest']:.3g}"
        for of in ("y", "x")
    )
    return lines + ["", f"Estimate over true error between 0.5 and 3: {found}. {machine(data)}."]


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
        "1e6), each step of every result called solved, and every `infeasible`, judged by an independent dense oracle (`bromwich_random_scenes`).",
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
        f"Estimate over error: {quantiles}; between 0.3 and 3 for {100 * data['effectivity_in_0.3_to_3']:.0f} %.",
    ]


def coverage(data):
    lines = ["| folder | lines | covered |", "|--|--|--|"]
    for folder, count in data["folders"].items():
        lines.append(f"| {folder} | {count['lines']} | {100 * count['covered'] / count['lines']:.1f} % |")
    return lines + ["", f"All tests, commit {data['commit'][:9]}, {data['compiler']}."]


def spread_of(row, key):
    """Median of an operation that not every run measures."""
    return seconds(row[key]["median"]) if row.get(key) else ""


def gpu_sweeps(data):
    lines = ["| Q | J | one sweep | as a graph | LCP, warm | of copy | sine transform | of DGEMM | scan | FFT | an array up, down |", "|--" * 11 + "|"]
    for row in data["rows"]:
        if row["part"] != "sweep":
            continue
        cells = [f"{row['Q']:g}", row["steps"], spread_of(row, "seconds"), spread_of(row, "recorded"), spread_of(row, "lcp")]
        cells += [f"{100 * row['lcp_of_copy']:.0f} %", spread_of(row, "transform"), f"{100 * row['transform_of_gemm']:.0f} %"]
        cells += [spread_of(row, "scan"), spread_of(row, "fft"), f"{spread_of(row, 'upload')} {spread_of(row, 'download')}".strip()]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def gpu_splits(data):
    """Table 4.1 of the paper beside the same split here; there is no interpolation in a sweep. The parts are timed alone,
    so that their sum may exceed the sweep: shares are of the larger of the two."""
    paper = [row for row in data["rows"] if row["part"] == "paper, Table 4.1"]
    if not paper:
        return []
    lines = ["", "| dx | the paper: LCP, linear algebra, interpolation, communication | here: LCP, transforms and scan, the rest |", "|--" * 3 + "|"]
    ours = {round(row["Q"]) + 1: row for row in data["rows"] if row["part"] == "sweep" and row["steps"] == 400}
    for row in paper:
        here = ours.get(row["cells"]) or ours[40]
        sweep = here["seconds"]["median"]
        whole = sweep + max(0.0, -here["other"])
        lcp, rest = here["lcp"]["median"] / whole, max(0.0, here["other"]) / whole
        dx = f"1/{row['cells']}" if row["cells"] in ours else f"1/{row['cells']} (here 1/40)"
        split = ", ".join(f"{row[key]:g} %" for key in ("lcp", "linear_algebra", "interpolation", "communication"))
        lines.append(f"| {dx} | {split} | {100 * lcp:.0f} %, {100 * (1 - lcp - rest):.0f} %, {100 * rest:.0f} % |")
    return lines


def gpu_solves(data):
    lines = ["", "| Q | J | method | sweeps | set-up | iterations or steps | in sweeps alone | total | error of y |", "|--" * 9 + "|"]
    for row in data["rows"]:
        if row["part"] != "solve":
            continue
        time, sweeps, error = row["seconds"], row.get("sweeps_seconds"), row.get("error_max")
        cells = [f"{row['Q']:g}", row["steps"], row["contestant"], row["iterations"] or "", seconds(time["setup"]), seconds(time["solve"])]
        cells += [seconds(sweeps) if sweeps else "", seconds(time["median"]), number(error) if error else ""]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def fit(data):
    lines = ["| scene | free | errors | converged | 95 % intervals that contain the truth | Jacobian |", "|--" * 6 + "|"]
    for name, row in data["cases"].items():
        free = ", ".join(row["truth"])
        inside = ", ".join(f"{parameter}: {100 * share:.1f} %" for parameter, share in row["coverage"].items())
        kinds = ", ".join(sorted({text.split(",")[0].split(" (")[0] for text in row["derivatives"]}))
        lines.append(f"| {name} | {free} | {row['noise']:g} | {row['converged']} of {row['seeds']} | {inside} | {kinds} |")
    return lines


def batches(data):
    lines = ["| scene | on | n | scenes | J | side by side | batch | loop of prepared solves | ratio |", "|--" * 9 + "|"]
    for row in data["rows"]:
        if "ns_batch" in row:
            lines.append(
                f"| {row['scene']} | {row['backend']} | {row['constraints']} | {row['scenes']} | {row['steps']} | {row['in_lanes']} | "
                f"{row['ns_batch']['median']:.1f} ns | {row['ns_single']['median']:.0f} ns | {row['ratio']:.0f} |"
            )
    lines += ["", f"Nanoseconds a scene and step, medians of {data['repeats']}. {data['machine']['cpu']}, {data['threads']} threads, "
              f"{data['compiler']}, {origin(data)}."]
    return lines


def derivative_costs(data):
    row = next(row for row in data["rows"] if "us" in row)
    lines = ["| | time | over a prepared solve |", "|--" * 3 + "|"]
    for name, us in row["us"].items():
        lines.append(f"| {name} | {us:.0f} us | {row['over_solve'][name]:.2f} |")
    lines += ["", f"A drawn scene with 4 constraints, {row['steps']} steps; a prepared solve takes {row['us_solve']:.0f} us. "
              f"{data['machine']['cpu']}, {data['compiler']}, {origin(data)}."]
    return lines


def gpu_operations(data):
    transforms = [row for row in data["rows"] if row["part"] == "transform"]
    small = [row for row in data["rows"] if row["part"] == "small problems"]
    lines = []
    if transforms:
        lines += ["", "| points | product, of DGEMM | cuFFT |", "|--" * 3 + "|"]
    for row in transforms:
        lines.append(f"| {row['n']} | {seconds(row['product'])}, {100 * row['product_of_gemm']:.0f} % | {seconds(row['fft'])} |")
    if small:
        lines += ["", "| n | problems a batch | problems/s, warm | of copy |", "|--" * 4 + "|"]
    for row in small:
        lines.append(f"| {row['n']} | {row['rows']} | {row['problems_per_second']:.2e} | {100 * row['of_copy']:.0f} % |")
    return lines


def gpu_quotes(data):
    quotes = [row for row in data["rows"] if row["part"] == "paper, Fig. 4.10"]
    times = "; ".join(f"dx = {row['dx']:.3g}: iteration {row['iteration_seconds'] / 60:g} min, implicit Euler {row['euler_seconds'] / 60:g} min" for row in quotes)
    return f" The paper's text on its Fig. 4.10, h = 0.01: {times}." if quotes else ""


def gpu(data):
    device = data["parameters"]
    return [
        *gpu_sweeps(data),
        *gpu_splits(data),
        *gpu_solves(data),
        *gpu_operations(data),
        "",
        f"{device['device']}: copies {device['copy_bytes_per_second'] / 1e12:.2f} TB/s, DGEMM {device['gemm_flops_per_second'] / 1e12:.1f} Tflop/s "
        f"in this run; a sweep is two sine transforms, a scan and the batch of problems with its report. Beside it {data['threads']} threads of "
        f"{machine(data)}, median of up to {data['repeats']} repeats.{gpu_quotes(data)}",
    ]


def bracket(data):
    """Errors of examples/bracket.py --convergence, a line for each of its quantities."""
    lines = ["| compliance | error of | sizes | errors | orders |", "|--" * 5 + "|"]
    for row in data["rows"]:
        sizes, errors = (", ".join(texts) for texts in (map(str, row["sizes"]), map(number, row["errors"])))
        orders = ", ".join(f"{order:.1f}" for order in row["orders"])
        lines.append(f"| {row['compliance']:g} | {row['name']} | {row['of']} {sizes} | {errors} | {orders} |")
    return lines
