"""The sentences of docs/ outside tables that quote measurements, as bench/results makes them. `scripts/tables --check` looks
for each of them in its file: after a new measurement the sentence has to be written anew, or its claim given up."""
import re
import tomllib

import evidence
import tables_gpu


def device_times():
    """Whole solves of the nonlinear scene by (steps, contestant, tolerance): `iteration` on the device, others on the host."""
    rows = evidence.load("nonlinear-gpu")["rows"]
    return {(r["steps"], r["contestant"], r.get("tolerance")): r for r in rows
            if (r["backend"] == "cuda") == (r["contestant"] == "iteration")}


def nonlinear_device():
    at = device_times()
    reached = min(steps for (steps, who, _), r in at.items() if r.get("error", 1) <= 1e-4)
    finest = max(steps for steps, _, _ in at)

    def best(steps, who):
        return min(r["seconds"]["median"] for (s, w, _), r in at.items() if (s, w) == (steps, who))

    ratios = [best(steps, "iteration by marches") / best(steps, "iteration") for steps in (reached, finest)]
    linear = [best(steps, "one linear march") / best(steps, "iteration") for steps in (reached, finest)]
    yield (f"From an error of 1e-4 on ({reached} steps) the device is {min(ratios):.1f} to {max(ratios):.1f} times as fast. One march "
           f"of the linear scene takes {min(linear):.2f} to {max(linear):.2f} of its time, and no march of the nonlinear scene takes less.")
    few, many = at[finest, "iteration", 1e-6], at[finest, "iteration", 1e-12]
    each = (many["seconds"]["median"] - few["seconds"]["median"]) / (many["linear_solves"] - few["linear_solves"])
    solve = min(r["seconds"]["solve"] for r in evidence.load("speed-vs-error-gpu")["rows"]
                if r["steps"] == finest and r.get("contestant", r.get("method")) == "multigrid")
    yield (f"With {finest} steps each further linear solve takes about {1e3 * each:.0f} ms on the device, where one of `signorini` of "
           f"this size takes {1e3 * solve:.0f} ms without set-up")


def shockley():
    with open(evidence.root / "examples/nonlinear/shockley.toml", "rb") as file:
        p = tomllib.load(file)["parameters"]
    yield f"Shockley's law has a slope of {p['V'] / p['I']:,.0f} at y = 0".replace(",", " ")


def comparison():
    rows = evidence.load("paper")["rows"]
    at_40 = {r["sweeps"] for r in rows if r["figure"] == "4.10" and r["contestant"] == "contour, to (4.8)" and abs(r["dx"] * 40 - 1) < 1e-9}
    at_40 |= {r["sweeps_to_tolerance"] for r in rows if r["figure"] == "4.6 right" and abs(r["dx"] * 40 - 1) < 1e-9}
    counts = " or ".join(map(str, sorted(at_40)))
    yield f"We need {counts} sweeps where the paper quotes 5."
    failed = [f"1/{1 / r['h']:.0f}" for r in rows if r["figure"] == "4.3 left" and r["method"] == "contour" and r["status"] != "solved"]
    yield f"at h = {' and '.join(failed)} the iterates of dlcp-small become infeasible"
    yield f"takes 27.5 minutes for 400 steps with 39 constraints, {27.5 * 60 / 400:.1f} s per step."


def case_two():
    measured, printed = tables_gpu.case_two(), tables_gpu.printed_case_two
    if set(measured) == set(printed):
        yield f"Case II is [measured on a device](../measurements/gpu.md) at all {len(printed)} columns of the paper's table."


def choices_of_auto():
    methods = [r["method"] for r in evidence.load("scenes")["rows"] if r.get("method")]
    if not {"contour", "multigrid"} & set(methods):
        yield f"In none of the {len(methods)} example scenes does `auto` take the iteration ([scenes](../scenes.md))"


def sweeps_of_signorini():
    rows = evidence.load("paper")["rows"]
    shares = [r["sweeps_to_tolerance"] / (1 / r["dx"] - 1) for r in rows if r["figure"] == "4.6 right"]
    whole = [r["iterations"] / r["Q"] for r in evidence.load("gpu")["rows"] if r["part"] == "solve" and r["contestant"] == "contour, cuda"]
    yield (f"on `signorini` it is {min(shares):.2f} to {max(shares):.2f} Q to the tolerance (4.8) of the paper "
           f"([table](papers/laplace.md)) and {min(whole):.2f} to {max(whole):.2f} Q to 1e-12 ([table](measurements/gpu.md)).")


def three_dimensions():
    rows = {}
    for r in evidence.load("signorini3d-gpu")["rows"]:
        if r["backend"] == "cuda" and "skipped" not in r and r["status"] == "solved":
            rows.setdefault((round(r["Q"]), r["steps"]), {})[r["contestant"]] = r
    pairs = {size: (r["march"], r["multigrid"]) for size, r in rows.items() if r["multigrid"]["convolutions"] > 0}
    ratio = lambda size, part: pairs[size][0]["seconds"][part] / pairs[size][1]["seconds"][part]
    without = [ratio(size, "solve") for size in pairs]
    whole = [f"{ratio((Q, J), 'median'):.2g} (Q = {Q}, J = {J})" for Q, J in pairs]
    yield f"Without set-up they are {min(without):.0f} to {max(without):.0f} times as fast as marching there"
    yield f"Of whole solves the ratio is {', '.join(whole[:-1])} and {whole[-1]}"


sentences = {
    "docs/three-dimensions.md": (three_dimensions,),
    "docs/method.md": (sweeps_of_signorini,),
    "docs/nonlinear.md": (nonlinear_device, shockley),
    "docs/papers/laplace.md": (comparison, case_two, choices_of_auto),
}


def missing():
    """One line for each sentence that its file does not have."""
    lines = []
    for file, makers in sentences.items():
        text = " ".join(re.sub(r"^\s*- ", "", (evidence.root / file).read_text(), flags=re.M).split())
        lines += [f"{file} does not say '{sentence}', as bench/results does" for make in makers for sentence in make()
                  if sentence not in text]
    return lines
