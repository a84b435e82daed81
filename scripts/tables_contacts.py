"""Tables of bench/results/contacts.json (scripts/bench_contacts): march across impacts, alone and beside Siconos."""
from evidence import number, origin, plain, seconds


def table(head, rows):
    return ["| " + " | ".join(head) + " |", "|--" * len(head) + "|"] + ["| " + " | ".join(map(str, row)) + " |" for row in rows]


def errors(data):
    """Of the block with reference digits, a column each number of steps."""
    block = [row for row in data["rows"] if row["part"] == "block"]
    steps = sorted({row["steps"] for row in block})
    found = {(row["e"], row["steps"]): number(row["error"]) if row["status"] == "solved" else row["status"] for row in block}
    lines = table(["e", *(f"{J} steps" for J in steps)], [[f"{e:g}", *(found[e, J] for J in steps)] for e in sorted({row["e"] for row in block})])
    return lines + ["", f"Error of q at T = 10 of the block on the belt, against a flow with located events; {origin(data)}."]


def fastest(rows, error):
    able = [row for row in rows if row["status"] == "solved" and row["seconds"] and row["error"] is not None and row["error"] <= error]
    return min(able, key=lambda row: row["seconds"]["median"], default=None)


def chains(data):
    """Of each chain the most accurate run of Siconos, beside the fastest of march with an error of q no larger; without Siconos march
    to 1e-4."""
    rows = [row for row in data["rows"] if row["part"] == "chain"]
    lines = []
    for blocks, e in sorted({(row["blocks"], row["e"]) for row in rows}):
        here = [row for row in rows if (row["blocks"], row["e"]) == (blocks, e)]
        march = [row for row in here if row["contestant"] == "bromwich march"]
        peers = [row for row in here if row["contestant"].startswith("Siconos") and row["error"] is not None and row["seconds"]]
        peer = min(peers, key=lambda row: row["error"], default=None)
        ours = fastest(march, peer["error"] if peer else 1e-4)
        finer = fastest(march, 1e-4)
        cells = [blocks, f"{e:g}"]
        cells += [f"{peer['steps']} steps, {number(peer['error'])}", seconds(peer["seconds"]["median"])] if peer else ["-", "-"]
        if ours and peer:
            ratio = plain(peer["seconds"]["median"] / ours["seconds"]["median"])
            cells += [f"{ours['steps']} steps, {number(ours['error'])}", seconds(ours["seconds"]["median"]), ratio]
        else:
            cells += ["-", "-", "-"]
        cells.append(f"{seconds(finer['seconds']['median'])} ({finer['steps']} steps)" if finer else "-")
        lines.append(cells)
    head = ["contacts", "e", "Siconos, error of q", "time", "march, error no larger", "time", "Siconos / march", "march to 1e-4"]
    return table(head, lines) + [
        "",
        f"Chains of blocks on the ground, T = 4. Siconos {data['details']['siconos']}: Moreau-Jean, theta = 1/2, from Python; its run with the "
        f"least error. {data['machine']['cpu']}, one thread, median of {data['repeats']} rounds in which all take turns"
        f"{', a short run' if data['details']['quick'] else ''}; {origin(data)}.",
    ]


def structures(data):
    """Verdicts of random planar structures, by whether the forces determine the motion."""
    words = {"unique": "one solution", "unique-motion": "one motion", "unknown": "several, or not known", "none": "not looked at"}
    shown = ("right", "missed", "wrong", "refused", "slow", "crashed", "undecided")
    rows = [[words.get(kind, kind), *(found.get(verdict, 0) for verdict in shown)] for kind, found in sorted(data["verdicts"].items())]
    return table(["solutions", *shown], rows) + [
        "",
        f"{data['count']} structures, seeds from {data['first_seed']} on, with 1 to {data['most_contacts']} contacts; method {data['method']}, "
        f"tolerance {data['tolerance']:g}. Largest error of those that are right {number(data['largest_error'])}, energy of located "
        f"events balanced to {number(data['largest_energy_of_events'])}. Undecided: the reference gives none; {origin(data)}.",
    ]


def gears(data):
    """What became of a batch of gears and its derivatives."""
    found, spent = data["differences"], data["cpu_seconds"]
    count = data["count"]
    rows = [
        ["solved", data["solved"], f"{1e3 * spent['solves'] / count:.0f} ms"],
        ["with derivatives by mu and e", data["with_derivatives"], f"{1e3 * spent['derivatives'] / count:.0f} ms"],
        ["without, with a reason", sum(data["masked"].values()), ""],
    ]
    return table([f"{count} gears", "number", "processor time each"], rows) + [
        "",
        f"{found['compared']} derivatives beside differences of located events of the tests: largest error {number(found['largest_error'])}. "
        f"{found['masked_but_smooth']} of those without have differences that agree, {found['undecided']} have none; {origin(data)}.",
    ]


def responses(data):
    """Frequency responses: points, times, and what they are compared with."""
    jenkins, impact = data["rows"]
    apart = max(abs(row["branch"] - row["transient"]) / row["transient"] for row in jenkins["transients"])
    grazing = next(mark["w"] for mark in impact["marks"] if mark["event"] == "grazing")
    rows = [
        ["two Jenkins elements", jenkins["points"], seconds(jenkins["cpu_seconds"]["median"]), f"long transients, within {number(apart)}"],
        ["impact oscillator", impact["points"], seconds(impact["cpu_seconds"]["median"]),
         f"grazing at {grazing:.5f}, of free motion {impact['grazing_of_free_motion']:.5f}"],
    ]
    return table(["branch", "points", "processor time", "beside"], rows) + ["", f"{data['machine']['cpu']}; {origin(data)}."]


def cones(data):
    """Contact problems of files, one row each."""
    rows = [[row["file"].rsplit(".", 1)[0], row["contacts"], row["rank"], row["status"], number(row["natural"]), seconds(row["cpu_seconds"]["median"])]
            for row in data["rows"]]
    return table(["file", "contacts", "rank of W", "status", "natural residual", "processor time"], rows) + [
        "", f"The files with which Siconos tests; {data['machine']['cpu']}, {origin(data)}."]
