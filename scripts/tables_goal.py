"""Tables of bench/results/goal.json: goal-oriented grids. Each function gives lines of markdown."""
from evidence import machine, number, seconds


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|--" * len(head) + "|"] + ["| " + " | ".join(row) + " |" for row in rows]


contestants = (
    "euler, uniform",
    "euler, goal",
    "euler, goal, doubling",
    "euler, goal, block-Jacobi 1",
    "euler, goal, block-Jacobi 8",
    "euler, goal, paper's indicator",
    "euler, goal, paper's indicator, block-Jacobi 1",
    "euler, equidistributed",
    "midpoint, uniform",
    "midpoint, goal",
    "exponential, uniform",
    "exponential, goal",
    "euler, divided",
    "midpoint, divided",
)


def row_of(data, scene, contestant, steps):
    for row in data["rows"]:
        if row["scene"] == scene and row["contestant"] == contestant and row["steps"] == steps:
            return row
    return None


def steps_of(data):
    return sorted({row["steps"] for row in data["rows"]})


def balance(data, scene):
    steps = steps_of(data)
    shown = steps if len(steps) < 4 else [s for s in steps if s in (50, 200, 800)]
    last = shown[-1]
    lines = []
    for name in contestants:
        rows = [row_of(data, scene, name, s) for s in shown]
        if None in rows:
            continue
        end = rows[-1]
        time = seconds(end["seconds"]["median"]) if end["seconds"] else "-"
        effectivity = f"{end['effectivity']:.2f}" if end["effectivity"] is not None else ""
        lines.append([name, *[number(row["I_loc"]) for row in rows], number(end["violation_right"]), number(end["violation_linear"]), number(end["error_x"]), effectivity, time])
    head = ["grid", *[f"I_loc, {s} steps" for s in shown], f"Σ\\|v\\| by right ends, {last}", "by straight lines", "error of x", "effectivity", "time"]
    return table(head, lines)


def saturation(data):
    rows = data["details"]["figures"]["saturation"]
    steps = sorted({row["steps"] for row in rows})
    lines = []
    for variant, name in ((1, "J - R1"), (2, "J - I"), (3, "J - 10 I")):
        for sweeps in (1, 8, 64):
            found = {row["steps"]: row[f"error_{sweeps}"] for row in rows if row["variant"] == variant}
            lines.append([name, str(sweeps), *[f"{found[s]:.2g}" for s in steps]])
    return table(["", "sweeps", *[f"{s} steps" for s in steps]], lines)


def switching(data):
    lines = []
    for row in data["details"]["switching"]:
        if row["steps"] in (100, 200, 400, 800, 1600):
            lines.append([str(row["steps"]), row["contestant"], number(row["I_loc"]), number(row["violation"]), number(row["error_x_at_T"]), seconds(row["seconds"]["median"])])
    return table(["steps", "`ladder-diodes`", "I_loc", "Σ\\|v\\|", "error of x(T)", "time"], lines)


def ladder_cycles(data):
    lines = []
    for entry in data["details"]["figures"]["ladder"]:
        history = entry["history"]
        ratios = [row["quantity"] / row["uniform"] for row in history]
        last = history[-1]
        lines.append([entry["name"], str(history[0]["steps"]), str(last["steps"]), number(last["quantity"]), number(last["uniform"]), f"{ratios[-1]:.2f}", f"{min(ratios):.2f} to {max(ratios):.2f}"])
    return table(["ladder", "first steps", "steps", "I_loc", "uniform", "ratio", "ratio of all cycles"], lines)


def goal(data):
    return [
        "`ph-toy`:",
        "",
        *balance(data, "ph-toy"),
        "",
        "`ladder`:",
        "",
        *balance(data, "ladder"),
        "",
        *ladder_cycles(data),
        "",
        *switching(data),
        "",
        "Relative error of the block-Jacobi adjoint of I_loc, uniform grids of `ph-toy`:",
        "",
        *saturation(data),
        "",
        *["- " + note for note in data["notes"]],
        "",
        f"Time: all grids from 20 steps on. {machine(data)}.",
    ]


def goal_peers(data):
    steps = [s for s in sorted({row["steps"] for row in data["rows"]}) if s in (50, 200, 800)]
    lines = []
    for scene in ("ph-toy", "ladder"):
        for name in ("scipy BDF", "scipy Adams"):
            rows = {row["steps"]: row for row in data["rows"] if row["scene"] == scene and row["contestant"] == name}
            lines.append([scene, name] + [number(rows[s][key]) for key in ("violation_right", "violation_linear") for s in steps] + [seconds(rows[steps[-1]]["seconds"]["median"])])
    head = ["scene", "solver", *[f"right ends, {s}" for s in steps], *[f"straight lines, {s}" for s in steps], "time"]
    return table(head, lines) + ["", f"SciPy's BDF and Adams (VODE, rtol 1e-6), Σ\\|v\\| of x at equal time points. {data['machine']['cpu']}, {data['compiler']}."]


def adjoints(data):
    """One line a chain and way, the processor beside the device."""
    found = {}
    for row in data["rows"]:
        chain = (row["states"], row["steps"], row["sizes"], row["sparse"])
        found.setdefault(chain, {}).setdefault(row["what"], {})[row["backend"]] = row
    lines = []
    for (states, steps, sizes, sparse), ways in found.items():
        title = f"m = {states}{', sparse' if sparse else ''}, {steps} steps of {sizes} size{'s' if sizes > 1 else ''}"
        for what, on in ways.items():
            times = [seconds(on[backend]["seconds"]["median"]) if backend in on else "" for backend in ("cpu", "cuda")]
            error = max(row["difference_max"] for row in on.values())
            lines.append([title, what, *times, number(error) if error > 0 else ""])
            title = ""
    device = data["parameters"].get("device", "no device")
    head = ["chain", "", "processor", "device", "differs from substitution by"]
    return table(head, lines) + ["", f"{device}; {machine(data)}, median of {data['repeats']}."]
