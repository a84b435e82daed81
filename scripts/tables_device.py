"""The table of the device beside one core of its machine, and its line in README.md."""
from evidence import machine, seconds
from tables_studies import fastest, plain

errors = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def of_device(data):
    return [row for row in data["rows"] if row["backend"] == "cuda"]


def of_one_core(data):
    return [row for row in data["rows"] if row["backend"] == "cpu" and row["threads"] == 1]


def shortest(rows, error, part):
    """The solved row within `error` whose seconds[part] are fewest, or None."""
    fit = [row for row in rows if row["status"] == "solved" and row["error"]["y"]["max"] <= error]
    return min(fit, key=lambda row: row["seconds"][part], default=None)


def cell(row, part):
    return f"{row['contestant']}, {row['steps']} steps: {seconds(row['seconds'][part])}" if row else "not reached"


def ratio(slow, fast, part):
    return plain(slow["seconds"][part] / fast["seconds"][part]) if slow and fast else "-"


def speed_vs_error_device(data):
    lines = [
        "| error of y | time | H200 | best marching, one core | implicit Euler, one core | marching / H200 | Euler / H200 |",
        "|--" * 7 + "|",
    ]
    for error in errors:
        for part, name in (("median", "whole"), ("solve", "without set-up")):
            device = shortest(of_device(data), error, part)
            march, euler = (
                shortest([row for row in of_one_core(data) if row["method"] == method], error, part)
                for method in ("march", "euler")
            )
            cells = [f"{error:.0e}", name, cell(device, part), cell(march, part), cell(euler, part)]
            cells += [ratio(march, device, part), ratio(euler, device, part)]
            lines.append("| " + " | ".join(cells) + " |")
    return lines + ["", f"{data['parameters']['device']}. {machine(data)}, median of {data['repeats']} interleaved repeats."]


def headline_device(data):
    error = 1e-4
    device = fastest(of_device(data), error)
    march = fastest(of_one_core(data), error, {"march"})
    euler = fastest(of_one_core(data), error, {"euler"})
    without = shortest(of_device(data), error, "solve")
    march_without = shortest([row for row in of_one_core(data) if row["method"] == "march"], error, "solve")
    euler_without = shortest([row for row in of_one_core(data) if row["method"] == "euler"], error, "solve")
    return [
        f"- Q = 511, error of y {error:.0e}, one H200 against one core beside it: whole solve **{seconds(device['seconds']['median'])}** "
        f"by {device['contestant']}, the best marching takes {ratio(march, device, 'median')} times and our implicit Euler "
        f"{ratio(euler, device, 'median')} times as long; without set-up **{seconds(without['seconds']['solve'])}** by "
        f"{without['contestant']}, {ratio(march_without, without, 'solve')} times and "
        f"{ratio(euler_without, without, 'solve')} times."
    ]
