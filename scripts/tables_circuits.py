"""Tables of bench/results/circuits.json (scripts/bench_circuits): the circuits of tests/circuits/set beside ngspice."""
from evidence import number, origin, plain, seconds

OURS = "bromwich"
DEFAULT = "ngspice, sidiode"
TIGHT = "ngspice, sidiode, tight"
CONTESTANTS = {OURS: "bromwich", DEFAULT: "ngspice, default", "ngspice, junction": "ngspice, junction", TIGHT: "ngspice, tight"}


def by_circuit(data):
    circuits = {}
    for row in data["rows"]:
        circuits.setdefault(row["circuit"], {})[row["contestant"]] = row
    return circuits


def solved(row):
    return row["status"] == "solved"


def median(row):
    return row["seconds"]["median"]


def ratio(rows, other):
    """Of CPU times, or nothing where one of them did not solve the circuit."""
    return median(rows[OURS]) / median(rows[other]) if solved(rows[OURS]) and solved(rows[other]) else None


def span(values):
    return f"{number(min(values))} to {number(max(values))}"


def middle(values):
    return sorted(values)[len(values) // 2]


def measured(data):
    return f"{data['machine']['cpu']}, one thread, median CPU time of {data['repeats']} interleaved repeats, {data['ngspice']}; {origin(data)}."


def counts(data):
    """Of each contestant: circuits solved, errors, and beside how many of them bromwich took more CPU time."""
    circuits = by_circuit(data)
    lines = ["| | solved | error, smallest to largest | median | bromwich takes less CPU time | more |", "|--|--|--|--|--|--|"]
    for contestant, name in CONTESTANTS.items():
        rows = [rows[contestant] for rows in circuits.values() if solved(rows[contestant])]
        errors = [row["error"] for row in rows]
        against = [r for r in (ratio(rows, contestant) for rows in circuits.values()) if r is not None]
        beside = ["", ""] if contestant == OURS else [sum(r <= 1 for r in against), sum(r > 1 for r in against)]
        cells = [name, f"{len(rows)} of {len(circuits)}", span(errors), number(middle(errors)), *beside]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines + ["", measured(data)]


def lost(data):
    """Where ngspice takes less CPU time with its own steps, most first."""
    found = [(ratio(rows, DEFAULT), name, rows) for name, rows in by_circuit(data).items() if (ratio(rows, DEFAULT) or 0) > 1]
    lines = ["| circuit | ngspice, default | its error | bromwich | its error | bromwich / ngspice |", "|--|--|--|--|--|--|"]
    for by, name, rows in sorted(found, key=lambda entry: entry[0], reverse=True):
        cells = [name]
        for contestant in (DEFAULT, OURS):
            cells += [seconds(median(rows[contestant])), number(rows[contestant]["error"])]
        lines.append("| " + " | ".join([*cells, plain(by)]) + " |")
    return lines + ["", measured(data)]


def failures(data):
    lines = ["| circuit | contestant | it ends with |", "|--|--|--|"]
    lines += [f"| {row['circuit']} | {CONTESTANTS.get(row['contestant'], row['contestant'])} | {row['status']} |"
              for row in data["rows"] if not solved(row)]
    return lines + ["", measured(data)]


def all_circuits(data):
    heads = [f"{name}: error | time" for name in CONTESTANTS.values()]
    lines = ["| circuit | " + " | ".join(heads) + " |", "|--" * (1 + 2 * len(heads)) + "|"]
    for name, rows in by_circuit(data).items():
        cells = [name]
        for contestant in CONTESTANTS:
            row = rows[contestant]
            cells += [number(row["error"]), seconds(median(row))] if solved(row) else ["fails", ""]
        lines.append("| " + " | ".join(cells) + " |")
    known = number(data["reference"]["error"])
    return lines + ["", f"The known values are of two runs that differ by {known} at most. {measured(data)}"]


def operating_map(data):
    """Seconds of the map of operating points, on one and two threads."""
    lines = ["| threads | s | ms a point |", "|--|--|--|"]
    for row in data["rows"]:
        lines.append(f"| {row['threads']} | {plain(median(row))} | {plain(1e3 * median(row) / data['points'])} |")
    about = f"{data['points']} points, {data['solved']} solved. {data['machine']['cpu']}, whole command, median of {data['repeats']} interleaved repeats; {origin(data)}."
    return lines + ["", about]
