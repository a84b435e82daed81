"""The tables of README and docs that come from studies of `bromwich bench`: each takes the measurements and gives lines
of markdown."""
from evidence import machine, number, origin, repeats, seconds


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
    lines = ["| backend | Q | J | method | set-up | solve | whole | cycles | applications of K + passes | residual | error of y, estimated |", "|--" * 11 + "|"]
    estimates = {(row["Q"], row["steps"]): row["discretisation_error"] for row in data["rows"] if row.get("discretisation_error")}
    skipped = []
    for row in data["rows"]:
        if "skipped" in row:
            skipped.append(f"{row['backend']} at Q = {row['Q']:g}, J = {row['steps']}, {row['contestant']}: {row['skipped']}")
            continue
        cycled = row["convolutions"] > 0
        work = f"{row['convolutions']:.1f} + {row['passes']:.1f}" if cycled else ""
        lines.append(
            f"| {row['backend']} | {row['Q']:g} | {row['steps']} | {row['contestant']} | {seconds(row['seconds']['setup'])} | {seconds(row['seconds']['solve'])} | "
            f"{seconds(row['seconds']['median'])} | {row['cycles'] if cycled else ''} | {work} | {number(row['residual'])} | "
            f"{'' if row['contestant'] == 'euler' else number(estimates.get((row['Q'], row['steps'])))} |"
        )
    return lines + ["- not run: " + what for what in skipped] + [
        "",
        "multigrid: until the algebraic error is estimated below a twentieth of the discretisation error. Solve includes the residual "
        "and the copy of y to the host. Applications and passes are counted on all grids, in units of the finest one. Without cycles: "
        "too few steps for coarser grids. The error is that of the grid, from coarser ones, and the same for `march`; that of implicit "
        f"Euler is not known. {machine(data)}, medians.",
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


def scenes(data, full=False):
    """Every example by auto; `full`: with its spectrum and steps."""
    heads = ["scene", "m", "n", "M", *["spectrum of A"] * full, "method", *["steps"] * full, "error of x", "error of y", "status", "time"]
    lines = ["| " + " | ".join(heads) + " |", "|--" * len(heads) + "|"]
    for row in data["rows"]:
        if row["scene"] == "template":  # rlcd once more
            continue
        status = row["status"]
        if status == "infeasible" and row["infeasible_at"] is not None:
            status += f" at t = {row['infeasible_at']:.4g}"
        if not row["as_expected"]:
            status += " (not as the file says)"
        cells = [f"[{row['scene']}](../examples/{row['scene']}.toml)", row["states"], row["constraints"],
                 row["class"] if full else row["class"].split(" (")[0], *[row["spectrum"]] * full, row["method"], *[row["steps"]] * full,
                 number(row["error_x"]), number(row["error_y"]), status, seconds(row["seconds"]["median"])]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines + ["", f"Time: the whole solve without states, median of {data['repeats']} repeats. {machine(data)}."]


def scenes_full(data):
    return scenes(data, full=True)


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
    """Both contestants with equal steps and at equal error. 10^6 states have no reference."""
    error = lambda value: "" if value is None else number(value)
    lines = ["| states | contacts | compliance | at | | steps | by Euler | error of w | mean error of y | set-up | whole solve | min to max | memory |"]
    lines.append("|--" * 13 + "|")
    for row in data["rows"]:
        time, euler = row["seconds"], row["contestant"] == "sparse euler"
        threads = f", {row['threads']} threads" if "threads" in row else ""
        lines.append(
            f"| {row['states']} | {row['constraints']} | {row['parameters']['compliance']:g} | {row['at']} | {row['contestant']}{threads} | "
            f"{row['steps']} | {'' if euler else row['euler_steps']} | {error(row['error_w_max'])} | {error(row['error_y_mean'])} | "
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


def sweep_over_devices(rows):
    """One sentence for each number of ranks."""
    first = rows[0]
    times = "; ".join(
        f"{row['ranks']} rank{'s' if row['ranks'] > 1 else ''} {seconds(row['seconds']['median'])}" + (f" ({row['of_one']:.2f} times as fast)" if row["ranks"] > 1 else "")
        for row in rows
    )
    return (
        f"A sweep of {first['scenes']} scenes of the size of `dlcp-small`, J = {first['steps']}, a device for each rank, from the first scene to the "
        f"CSV file: {times}. Of these the devices take {seconds(first['solve']['median'])} in all on one rank; the host reads scenes and writes rows. "
        f"{first['device']}, medians of {first['repeats']}, commit {first['commit'][:9]}."
    )


def scale_gpu(data):
    """Cycles on one device and on all, then the largest scene."""
    lines = ["| scene | Q | steps on one | cycles on one | ranks | steps | cycles | applications of K | efficiency | apart |", "|--" * 10 + "|"]
    for name in data["details"]:
        rows = [row for row in data["rows"] if row["run"] == name and row["kind"] == "cycles"]
        one = next(row for row in rows if row["ranks"] == 1)
        for row in rows:
            if row["ranks"] > 1:
                lines.append(
                    f"| {row['scene']} | {row['Q']:g} | {one['steps']} | {seconds(one['seconds']['median'])} | {row['ranks']} | {row['steps']} | "
                    f"{seconds(row['seconds']['median'])} | {one['convolutions']:.1f}, {row['convolutions']:.1f} | {row['efficiency']:.2f} | "
                    f"{number(row['apart']) if 'apart' in row else ''} |"
                )
    sweeps = [row for row in data["rows"] if row["kind"] == "sweep"]
    largest = data["largest"]
    unknowns = largest["sizes"]["constraints"] * largest["steps"]
    return lines + [
        "",
        "Cycles: the nested start and the cycles until the algebraic error is below a twentieth of the discretisation error, medians. "
        "Efficiency: time on one device, for as many steps a device, relative to that on all; applications of K on one device and on all. "
        "Apart: the largest difference of y, relative to the largest y.",
        "",
        f"`signorini3d` with Q = 511 and {largest['steps']} steps, {unknowns / 1e9:.2f} 10^9 contact unknowns, on two devices: {largest['status']} to a residual of "
        f"{number(largest['residual'])} in {largest['cycles']} cycles; set-up {largest['seconds']['setup']:.1f} s, solve {largest['seconds']['solve']:.2f} s "
        f"with the copy of y to the host, {largest['bytes'] / 1e9:.0f} GB in all.",
        *(["", sweep_over_devices(sweeps)] if sweeps else []),
        "",
        f"Two and four of {data['details']['scale255']['device']}, {machine(data)}.",
    ]


def timeline(data):
    """What devices do in a solve, and what their messages take beside the model."""
    kinds = [kind for kind in data["rows"][0]["seconds"][0] if kind != "other"]
    lines = ["| Q | devices | " + " | ".join(kinds) + " | messages: states, rows, grids | transfer | model | ratio |", "|--" * (len(kinds) + 6) + "|"]
    for row in data["rows"]:
        times = [seconds(sum(of_rank[kind] for of_rank in row["seconds"])) for kind in kinds]
        found = row.get("messages")
        sent = [", ".join(str(found["numbers"][name]) for name in ("states", "rows", "gathers")), seconds(found["transfer"]),
                seconds(found["model"]), f"{found['ratio']:.2f}"] if found else [""] * 4
        lines.append(f"| {row['Q']} | {row['ranks']} | {' | '.join([*times, *sent])} |")
    return lines + [
        "",
        "Times of kinds are summed over the devices. \"Messages\" is with what devices wait for one another, \"transfer\" without it: the shortest "
        "time of each message over the devices. The model is latency + bytes / bandwidth of each message, terms as measured for messages alone. "
        f"{data['device']}, commit {data['commit'][:9]}.",
    ]


def fields_peers(data):
    """Each contestant at equal error, then factorizations beside SuiteSparse."""
    lines = ["| states | compliance | | steps | error of w | mean error of y | set-up | whole solve | min to max | times march | memory |"]
    lines.append("|--" * 11 + "|")
    march = 1.0
    for row in data["rows"]:
        time, stopped = row["seconds"], row["status"].startswith("stopped")
        march = time["median"] if row["contestant"] == "bromwich march" else march
        errors = [number(row[name]) if row[name] is not None else "as above" for name in ("error_w_max", "error_y_mean")]
        memory = row.get("peak_bytes") or row.get("bytes")
        lines.append(
            f"| {row['states']} | {row['parameters']['compliance']:g} | {row['contestant']} | {row['steps']} | {errors[0]} | "
            f"{errors[1]} | {seconds(time['setup'])} | {'about ' if stopped else ''}{seconds(time['median'])} | "
            f"{seconds(time['min'])} to {seconds(time['max'])} | {time['median'] / march:.1f} | {f'{memory / 1e6:.0f} MB' if memory else ''} |"
        )
    for found in data["factors"]:
        node, eigen, cholmod = found["node"], found["eigen"], found["cholmod"]
        lines += ["", f"- m = {found['states']}, n = {found['constraints']}, one thread. Values at a complex node take our elimination "
                  f"{seconds(node['elimination'])}, UMFPACK {seconds(node['umfpack'])}. A real factorization takes Eigen "
                  f"{seconds(eigen['factorization'])}, CHOLMOD {seconds(cholmod['factorization'])}. One solve takes {seconds(eigen['solve'])} and "
                  f"{seconds(cholmod['solve'])}."]
    stopped = any(row["status"].startswith("stopped") for row in data["rows"])
    about = "\"About\": a program was stopped, and its time is that of all steps at the pace of those done. " if stopped else ""
    about += "Memory of march and PETSc: of the process with Python; of the Euler: as it counts it. "
    return lines + ["", f"{about}{machine(data)}, {data['repeats']} rounds."]


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


def whole_batches(data):
    """One line a case: whole calls from Python, on every backend and with every place of the results."""
    ways = [way for way in (("cpu", "host"), ("cpu", "last"), ("cuda", "host"), ("cuda", "last"), ("cuda", "device"))
            if any((row["backend"], row["results"]) == way for row in data["rows"])]
    words = {"host": "all rows", "last": "last row", "device": "rows stay"}
    lines = ["| states, constraints | matrices | " + " | ".join(f"{backend}, {words[place]}" for backend, place in ways) + " |",
             "|--" * (2 + len(ways)) + "|"]
    cases = {}
    for row in data["rows"]:
        kind = {"P": "M of class P", "skew": "M skew, stages"}[row["class"]] + (", with f" if row["f"] else "")
        key = f"{row['states']}, {row['constraints']}, {kind}", row["matrices"]
        cases.setdefault(key, {})[row["backend"], row["results"]] = f"{row['ns']['median']:.1f}"
    lines += [f"| {name} | {matrices} | " + " | ".join(found[way] for way in ways) + " |" for (name, matrices), found in cases.items()]
    worst = max(row["difference"] for row in data["rows"])
    devices = "".join(f"{name}, " for name in data["machine"]["devices"])
    agree = f"x(T) differs by at most {worst:.0e} of the largest from that of the processor. {devices}" if devices else ""
    return lines + ["", f"Nanoseconds a scene and step, whole calls from Python, medians of {data['repeats']}: {data['scenes']} scenes, "
                    f"{data['steps']} steps. {agree}{data['machine']['cpu']}, {data['threads']} threads, {data['compiler']}, {origin(data)}."]


def streams(data):
    rows, one = data["rows"], data["rows"][0]
    lines = ["| threads | whole solve | of one thread's | prepared solve | of one thread's | solved |", "|--" * 6 + "|"]
    for row in rows:
        prepared = f"{seconds(row['prepared'])} | {row['prepared'] / one['prepared']:.2f}" if "prepared" in row else "- | -"
        by = f"{row['threads']}, `solve_batch`" if "by" in row else row["threads"]
        lines.append(f"| {by} | {seconds(row['whole'])} | {row['whole'] / one['whole']:.2f} | {prepared} | "
                     f"{row['solved']} of {row['solves']} |")
    lines += ["", f"Time a scene: {one['scenes']} scenes `signorini`, Q = {one['Q']:g}, J = {one['steps']}, diffusivities from 0.02 to 0.2, "
              f"method multigrid. Results differ by {max(row['difference'] for row in rows):.0e} from those of one thread. Medians of {data['repeats']}. "
              f"{data['parameters']['device']}, {data['machine']['cpu']}, {data['machine']['cores']} threads, {data['compiler']}, {origin(data)}."]
    return lines


def derivative_costs(data):
    row, *others = [row for row in data["rows"] if "us" in row]
    lines = ["| | time | over a prepared solve |", "|--" * 3 + "|"]
    for of in [row, *others]:
        scene = f"{of['scene']}, n = {of['constraints']}: " if of in others else ""
        if of.get("kind") == "over all time points":
            scene = f"{scene[:-2]}, by {of['method']} over all time points: "
        for name, us in of["us"].items():
            lines.append(f"| {scene}{name} | {us:.0f} us | {of['over_solve'][name]:.2f} |")
    lines += ["", f"A drawn scene with 4 constraints, {row['steps']} steps; a prepared solve takes {row['us_solve']:.0f} us. "
              f"{data['machine']['cpu']}, {data['compiler']}, {origin(data)}."]
    return lines


def derivatives(data):
    """The largest difference of each scene, and why data or scenes are refused."""
    lines = ["| scene | derivative | m, n | steps or switches | margin | largest difference | of | not by |", "|--" * 8 + "|"]
    reasons = {}
    for row in data["rows"]:
        if not row["kind"] or not row["error"]:
            reasons.setdefault(row["reason"] or "; ".join(sorted(set(row["refused"].values()))), []).append(row["scene"])
            continue
        worst = max(row["error"], key=lambda name: row["error"][name])
        lines.append(
            f"| {row['scene']} | {row['kind']} | {row['states']}, {row['constraints']} | {row.get('steps', row.get('switches'))} | "
            f"{row['margin']:.1e} | {row['error'][worst]:.1e} | {worst} | {', '.join(sorted(row['refused']))} |"
        )
    lines += ["", "Refused:", ""]
    lines += [f"- {', '.join(scenes)}: {why.removeprefix('derivative: ').split(';')[0]}" for why, scenes in reasons.items()]
    return lines + ["", *(f"{note}." for note in data["notes"]), f"{machine(data)}."]


def bracket(data):
    """Errors of examples/bracket.py --convergence, a line for each of its quantities."""
    lines = ["| compliance | error of | sizes | errors | orders |", "|--" * 5 + "|"]
    for row in data["rows"]:
        sizes, errors = (", ".join(texts) for texts in (map(str, row["sizes"]), map(number, row["errors"])))
        orders = ", ".join(f"{order:.1f}" for order in row["orders"])
        lines.append(f"| {row['compliance']:g} | {row['name']} | {row['of']} {sizes} | {errors} | {orders} |")
    return lines + ["", f"Written by `scripts/bench_bracket`. {machine(data)}."]
