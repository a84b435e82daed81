"""The tables of docs/papers/galerkin.md that come from `bromwich bench galerkin`."""
import evidence
from evidence import machine, number, seconds

norms = {"y_L2": "y in L2", "x_L2": "x in L2", "y_at_T": "y(T)", "x_at_T": "x(T)"}
methods = {"galerkin": "Galerkin", "euler": "implicit Euler"}


def rows_of(data, part, **wanted):
    rows = [row for row in data["rows"] if row["part"] == part]
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def line(cells):
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def order(value):
    return "exact" if value is None else f"{value:.2f}"


def orders(data):
    lines = ["| scene, grid | method | " + " | ".join(norms.values()) + " |", "|--" * 6 + "|"]
    for row in rows_of(data, "order"):
        lines.append(line([f"{row['scene']}, {row['grid']}", methods[row["method"]], *(order(row["order"][norm]) for norm in norms)]))
    return lines


def finest(data):
    """The largest grid that both methods solve, of every ladder."""
    lines = ["| scene, grid | steps | method | " + " | ".join(norms.values()) + " | exchanges | time |", "|--" * 9 + "|"]
    for scene, grid in dict.fromkeys((row["scene"], row["grid"]) for row in rows_of(data, "convergence")):
        solved = {m: {row["steps"]: row for row in rows_of(data, "convergence", scene=scene, grid=grid, method=m, solved=True)} for m in methods}
        both = sorted(set(solved["galerkin"]) & set(solved["euler"]))
        for method in methods if both else ():
            row = solved[method][both[-1]]
            cells = [f"{scene}, {grid}", row["steps"], methods[method], *(number(row["error"][norm]) for norm in norms)]
            lines.append(line([*cells, row["iterations"] or "-", seconds(row["seconds"])]))
    return lines


def unsolved(data):
    """What was not solved, in sentences."""
    failures = {}
    for row in rows_of(data, "convergence", solved=False):
        failures.setdefault((row["scene"], row["grid"], row["method"], row["reason"]), []).append(str(row["steps"]))
    return [f"- Not solved: {scene}, {grid}, {methods[m]}, with {', '.join(steps)} steps ({reason})." for (scene, grid, m, reason), steps in failures.items()]


def control(data):
    lines = []
    for method in methods:
        rows = rows_of(data, "control", method=method)
        good = [row for row in rows if row["cost_error"] <= 1e-6 and row["switch_error"] <= 1e-6]
        if not rows:
            continue
        last = rows[-1]
        reached = f"from {good[0]['steps']} steps on" if good else "not reached"
        lines.append(
            f"- lq-control, {methods[method]}: switches and cost to 1e-6 {reached}; with {last['steps']} steps the cost is off by "
            f"{last['cost_error']:.1e} and the switches by {last['switch_error']:.1e}."
        )
    return lines


def cost(data):
    lines = ["| scene | N | application | a solve | exchanges | memory |", "|--" * 6 + "|"]
    for scene in dict.fromkeys(row["scene"] for row in rows_of(data, "cost")):
        rows = rows_of(data, "cost", scene=scene)
        for row in (rows[0], rows[-1]):
            solve = seconds(row["solve_seconds"]) if row["status"] == "solved" else row["status"]
            lines.append(line([scene, row["steps"], seconds(row["application_seconds"]), solve, row["iterations"] or "-", f"{row['solve_bytes'] / 1e6:.1f} MB"]))
    return lines


def periodic(data):
    lines = ["| steps a period | Galerkin | marching to the limit | periods | largest difference of v |", "|--" * 5 + "|"]
    for row in rows_of(data, "periodic"):
        lines.append(line([row["steps"], seconds(row["seconds"]), seconds(row["march_seconds"]), row["march_periods"], number(row["difference"])]))
    return lines


def eigenvalues(data):
    lines = ["Smallest eigenvalue of the symmetric part of the operator; where it is positive, the solution is unique:", ""]
    rows = rows_of(data, "eigenvalue")
    for scene, printed, regularisation, weight in dict.fromkeys((row["scene"], row["as_printed"], row["regularisation"], row["lambda"]) for row in rows):
        last = {row["T"]: row for row in rows_of(data, "eigenvalue", scene=scene, as_printed=printed, **{"lambda": weight})}  # the finest grid of each
        title = scene + (", matrix as the paper prints it," if printed else "") + (f" with M + {regularisation:g} I" if regularisation else "") + (f", weight e^(-2 {weight:g} t)" if weight else "")
        lines.append(f"- {title}: " + ", ".join(f"{row['smallest']:.3f} at T = {T:.3g}" for T, row in last.items()))
    return lines


def ratio():
    return [
        f"- bridge, {row['steps']} steps, h = {row['h']:.5g}: the error of implicit Euler is {row['x_at_T']:.3g} times that of Galerkin for x(T), "
        f"{row['x_L2']:.3g} times for x and {row['y_L2']:.3g} times for y in L2."
        for row in evidence.load("galerkin-ratios")["rows"]
    ]


def galerkin(data):
    return [
        "Observed orders (slope of all errors above 1e-11; *exact*: fewer than two of them. The solution of nash-game with its kinks on nodes belongs to the space; what is left there are its sources):",
        "",
        *orders(data),
        "",
        "Errors on the finest grid that both methods solve:",
        "",
        *finest(data),
        "",
        *ratio(),
        *control(data),
        *unsolved(data),
        "",
        *eigenvalues(data),
        "",
        "Time and memory against the number of intervals N:",
        "",
        *cost(data),
        "",
        "The periodic state of a rectifier, against marching from rest until a period changes v by less than 1e-7:",
        "",
        *periodic(data),
        "",
        f"{machine(data)}, median of {data['repeats']} repeats.",
    ]
