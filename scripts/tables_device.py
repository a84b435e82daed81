"""The table of the device beside one core of its machine, and its line in README.md."""
from evidence import machine, origin, plain, seconds
from tables_speed import fastest

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
    march = fastest(of_device(data), error, {"march"})
    core = fastest(of_one_core(data), error, {"march"})
    return [
        f"- On that GPU, to an error of {error:.0e} in y with 511 points, the fastest whole solve is that of `{device['method']}`, in "
        f"**{seconds(device['seconds']['median'])}**. The best marching takes **{ratio(march, device, 'median')} times** as long on the GPU and "
        f"**{ratio(core, device, 'median')} times** on one core of its host ({origin(data)})."
    ]
