"""The tables of cycles in w (`bromwich bench dual`): each takes the measurements and gives lines of markdown."""
import math

from evidence import machine, number, origin, seconds


def measured(data):
    """The rows of the device, where there is one: they follow those of the host."""
    rows = data["rows"]
    first = next((k for k, row in enumerate(rows) if row.get("backend") == "cuda"), 0)
    return rows[first:]


def grids(data):
    return [row for row in measured(data) if "skipped" not in row and "equal_error" not in row and "put" not in row]


def at_equal_error(data):
    """{method: row}, the methods whose error of w is as wanted."""
    return {row["method"]: row for row in measured(data) if "equal_error" in row and row["error_w"] <= row["wanted"]}


def best_dual(rows, kind):
    return min((row for name, row in rows.items() if name.startswith("dual")), key=lambda row: row[kind]["median"])


def steps_for(row, error):
    """Steps at which the errors of the ladder, interpolated in logarithms, come to `error`; grids double, so that the last one may
    be far below what is wanted."""
    rungs = [(rung["steps"], rung["error_w"]) for rung in row["ladder"] if rung["error_w"]]
    for (few, large), (many, small) in zip(rungs, rungs[1:]):
        if large >= error >= small:
            return few * (many / few) ** (math.log(large / error) / math.log(large / small))
    return row["steps"]


def seconds_at(row, kind, error):
    """The median time of `kind`, its steps scaled to those for `error`, its set-up kept."""
    time = row[kind]
    return time["setup"] + (time["median"] - time["setup"]) * steps_for(row, error) / row["steps"]


def times(rows, method, kind):
    """How many times as long a method on one core takes, to the error of the cycles."""
    dual = best_dual(rows, kind)
    return seconds_at(rows[method], kind, dual["error_w"]) / dual[kind]["median"]


def headline_dual(data):
    rows = at_equal_error(data)
    dual = best_dual(rows, "whole")
    return [
        f"- On that GPU, to an error of {number(dual['error_w'])} in w with M = 0, a solve by cycles takes **{seconds(dual['whole']['median'])}**, prepared "
        f"**{seconds(best_dual(rows, 'prepared')['prepared']['median'])}**. Our fastest march on one core of its host, implicit Euler, takes "
        f"**{times(rows, 'euler', 'whole'):.1f}** and **{times(rows, 'euler', 'prepared'):.0f} times** as long to that error (its steps by interpolation). "
        f"A march on that GPU is not measured here ({origin(data)})."
    ]


def dual(data):
    lines = ["| backend | rule | Q | J | c | eps | μ | forecast | contraction | cycles | sweeps | algebraic error of w | error of w | "
             "algebraic error of y | error of y | plain sweeps | set-up | solve |", "|--" * 18 + "|"]  # fmt: skip
    for row in grids(data):
        useful = row.get("useful", {})
        needed = row["needed"] if "needed" in row else useful  # older measurements have the stop by estimates alone
        needed = needed or {}
        forecast, mean = row["forecast"], row["contraction"]["mean"]
        plain = useful.get("plain_sweeps")
        cells = [
            row["backend"],
            row["rule"],
            f"{row['Q']:g}",
            f"{row['steps']}",
            f"{row['c']:g}",
            f"{row['eps']:g}",
            f"{row['mu']:.3g}",
            "" if forecast is None else f"{forecast:.2f}",
            row["status"] if row["status"] != "solved" else "" if mean is None else f"{mean:.3f}",
            f"{row['cycles']}",
            f"{needed['sweeps']}" if needed else "more than 20",
            number(needed.get("algebraic_error_w")),
            number(useful.get("error_w")),
            number(needed.get("algebraic_error_y")),
            number(useful.get("error_y")),
            "more than 400" if "plain_sweeps" in useful and plain is None else "" if plain is None else f"{plain}",
            seconds(row["seconds"]["setup"]),
            seconds(row["seconds"]["solve"]),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    skipped = [row for row in measured(data) if "skipped" in row]
    sweeps = (
        "until the true algebraic errors of w and of y are both below a tenth of their discretisation errors"
        if any("needed" in row for row in measured(data))
        else "until the estimate of the algebraic error is below a tenth of that of the discretisation error"
    )
    return lines + [
        "",
        f"Sweeps: on the finest grid, {sweeps}. "
        "Plain sweeps: without coarse grids, to the algebraic error of w that one or two cycles have. Errors are the largest over time. "
        + (f"{len(skipped)} further grids were not run in the time of the study. " if skipped else "")
        + f"{machine(data)}.",
        "",
        *("- " + note for note in data["notes"]),
    ]


def dual_times(data):
    wanted = best_dual(at_equal_error(data), "whole")["error_w"]
    lines = [f"| method | on | steps | error of w | whole | prepared | steps for an error of {number(wanted)} | whole | prepared |", "|--" * 9 + "|"]
    for row in measured(data):
        if "equal_error" in row:
            lines.append(
                f"| {row['method']} | {'one core' if row['backend'] == 'cpu' else row['backend']} | {row['steps']} | {number(row['error_w'])} | "
                f"{seconds(row['whole']['median'])} | {seconds(row['prepared']['median'])} | {steps_for(row, wanted):.0f} | "
                f"{seconds(seconds_at(row, 'whole', wanted))} | {seconds(seconds_at(row, 'prepared', wanted))} |"
            )
    size = next(row["Q"] for row in measured(data) if "equal_error" in row)
    return lines + ["", f"Q = {size:g}, the fewest steps, by doubling, with an error of w below 1e-04, and then the steps that the errors of the ladder "
            f"ask for at equal error, by interpolation, with the time of the steps scaled to them. {machine(data)}."]


def put_words(row):
    """The words for a put and its parameters, those of the mesh left out."""
    given = {key: value for key, value in row["parameters"].items() if key != "points"}
    if "dividends" in given:  # of the same share each
        given["dividends"] = f"{given['dividends']:g} of {given.pop('dividend'):g}"
    settings = ", ".join(f"{key} = {value if isinstance(value, str) else format(value, 'g')}" for key, value in sorted(given.items()))
    return f"`{row['scene']}`" + (f", {settings}" if settings else "")


def puts(data):
    lines = ["| put | states | steps | value | reference | error | time, one core |", "|--" * 7 + "|"]
    for row in data["rows"]:
        if row.get("put") and row["method_asked"] == "auto":
            known = row["reference_known_to"]
            reference = f"{row['reference']:g}" if known > 1e-5 else f"{row['reference']:.9f}".rstrip("0")
            reference += f" to {known:.0e}" if row["source"] != "published" else ", published"
            value = row["status"] if row["value"] is None else f"{row['value']:.7f}"
            lines.append(
                f"| {put_words(row)} | {row['states']} | {row['steps']} | {value} | {reference} | {number(row['error'])} | "
                f"{seconds(row['seconds'])} |"
            )
    return lines + ["", f"`put`: S = K = 100, r = 0.05, q = 0, sigma = 0.2, T = 1 where nothing else is said. {machine(data)}."]
