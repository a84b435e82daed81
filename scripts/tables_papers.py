"""The tables of docs/papers/ and docs/nonlinear.md: what the papers claim, in their order, and what is found here. Every
number comes from bench/results."""
import bisect
import math

import evidence
from evidence import number, seconds


def line(cells):
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def table(header, rows):
    return [line(header), "|--" * len(header) + "|", *(line(row) for row in rows)]


def pick(rows, **wanted):
    return [row for row in rows if all(row.get(key) == value for key, value in wanted.items())]


def first(rows, **wanted):
    return pick(rows, **wanted)[0]


def fraction(value):
    return f"1/{1 / value:.0f}"


def laplace(paper):
    """Wu and Chen, in the order of their sections."""
    own = evidence.load("papers")
    rows = paper["rows"]
    c = own["constants"]
    small = pick(rows, figure="4.1")
    literal = [r for r in pick(rows, figure="4.3 right", method="contour-literal") if r["kernel_error"] and r["error_y"]]
    amplified = {r["nodes"]: r["error_y"] / r["kernel_error"] for r in literal}
    passed = own["amplification"]
    left = [r for r in pick(rows, figure="4.3 left", method="contour") if r["status"] == "solved" and r["order_y"]]
    tuned = own["remark_2_4"]
    at = {(r["degrees"], r["P"]): r for r in tuned}
    circles = [r for r in own["contour_2_3"] if r["P"] == 64]
    splines = {(r["source"], r["steps"]): r for r in own["remark_2_5"]}
    kinks, smooth = splines["y with kinks", 256], splines["smooth", 256]
    membrane = own["figures_4_7_and_4_8"]
    errors, size = membrane["errors"], membrane["largest_y"]
    euler = own["figure_4_4"]
    counts = pick(rows, figure="4.6 left")
    right = pick(rows, figure="4.6 right")
    sweeps = own["figure_4_2"]
    rate = lambda a, b: math.log(a / b) / (10 - 5)  # of e^{-δ sqrt P} from P = 25 to 100
    contours = evidence.load("contours")["rows"]
    names = ("zero, twice", "imaginary", "unstable", "all of them")
    found = lambda P, name: first(contours, part="around", spectrum=name, P=P)["error"]
    around = lambda P, *spectra: ", ".join(f"{number(found(P, name))} ({name})" for name in spectra or names)
    rate_64 = first(contours, part="around", P=64)["printed_rate"]
    initial = ", ".join(f"{number(r['error'])} (P = {r['P']})" for r in pick(contours, part="initial") if r["P"] in (4, 8, 12, 14, 20))
    nodes = {key: [r[key] for r in pick(contours, part="nodes of a step")] for key in ("by_the_rate", "found")}
    claims = [
        ("Remark 2.1, (2.3): circles about zero, imaginary and unstable eigenvalues",
         "`contour-literal` has them where eigenvalues lie outside its hyperbola. P = 64, worst over t = 0.01 to 100 of the integral of "
         f"e^{{As}}: {around(64)}, by the printed rate {number(rate_64)}. Agrees, with a hyperbola that is "
         f"chosen anew for each t; one that is not tuned misses e^A by {number(max(r['error'] for r in circles))} with the same P"),
        ("Remark 2.3: a second contour for e^{At} x0, O(e^{-2.32 P})", f"error {initial}. Agrees up to P = 14; beyond, rounding of "
         "e^{0.35 P} grows. `contour-literal` takes it with P = 14 where the spectrum is real"),
        ("Theorem 2.2: a bound of the sweeps",
         f"correct and far above: with L = {c['lipschitz_2']:.1f} and phi = {small[0]['bound_phi']:.2f} it is below the error of "
         f"the start from sweep {small[0]['bound_useful_from']} on; {small[0]['sweeps_to_1e-12']} and {small[1]['sweeps_to_1e-12']} "
         "sweeps are needed"),
        ("Remark 2.4: the contour can be retuned for angles above 0.7768",
         f"with μ, γ and Δv fitted to the angle the error at P = 100 is {number(at[44.5, 100]['error'])} at 44.5 degrees and "
         f"{number(at[70, 100]['error'])} at 70, against {number(at[44.5, 100]['error_with_contour_for_real_spectra'])} and "
         f"{number(at[70, 100]['error_with_contour_for_real_spectra'])} with the contour for real spectra. Between P = 25 and 100 "
         f"δ is {rate(at[0, 25]['error'] * 5, at[0, 100]['error'] * 10):.2f}, {rate(at[19.5, 25]['error'] * 5, at[19.5, 100]['error'] * 10):.2f} "
         f"and {rate(at[44.5, 25]['error'] * 5, at[44.5, 100]['error'] * 10):.2f} at 0, 19.5 and 44.5 degrees. Agrees; "
         f"`contour-literal` keeps the printed contour below 44.5 degrees and takes one around the eigenvalues from there on: P = 100, "
         f"{around(100, '44.5 degrees', '70 degrees', '85 degrees')}"),
        ("Remark 2.5: interpolation of high order is unnecessary",
         f"y with kinks, 256 steps: x errs by {number(kinks['lines'])} with lines and {number(kinks['splines'])} with cubic splines; a "
         f"smooth source: {number(smooth['lines'])} and {number(smooth['splines'])}. Agrees for y with kinks, of second order "
         "with both, not of first"),
        ("Theorem 3.2, (3.6): a T* up to which least elements exist in all sweeps",
         f"T* = {number(c['T_star_as_printed'])} of T = 1 for `dlcp-small`, with β = {c['beta']:.4f} and the L and Θ of (3.6), P = 25; "
         f"with exact inversion {c['T_star']:.4f}. With the term k = 0 of "
         f"(3.6) as printed, 1 <= β, there is none. At sweep 1 {100 * sweeps['infeasible']['1']:.0f} % of the time points have no "
         "feasible y: there (3.3) is not defined"),
        ("After Theorem 3.2: P from 4 to 100 for h from 0.1 to 1e-10", f"by the printed rate P = {nodes['by_the_rate'][0]} to "
         f"{nodes['by_the_rate'][-1]}, by the error over real spectra {nodes['found'][0]} to {nodes['found'][-1]}. Agrees"),
        ("Remark 3.1: semidefinite M, the least-norm solution",
         f"the iteration converges with M = (1 1; 1 1), in {own['remark_3_1']['sweeps']} sweeps to 1e-12 and to the values of marching "
         f"({number(own['remark_3_1']['from_marching'])} apart). Agrees where the null space does not move the state ([method](../method.md#classes-of-m))"),
        ("Fig. 4.1: the rate is robust in h", "; ".join(
            f"h = {fraction(r['h'])}: {r['sweeps_to_1e-12']} sweeps to 1e-12" for r in small)
         + ". Larger steps need more"),
        ("Fig. 4.2: a satisfactory solution after few sweeps",
         f"not for `dlcp-small`: where an iterate has no feasible y there is nothing to draw ({100 * sweeps['infeasible']['4']:.0f} % "
         f"of the time points at sweep 4, picture below), and x errs by {sweeps['error_of_x']['4']:.2f} there"),
        ("Fig. 4.3 left: O(h)", f"second order: mean {sum(r['order_y'] for r in left) / len(left):.2f} in the differences of y"),
        ("Fig. 4.3 right: O(e^{-2.06 √P}/√P)",
         f"at P = 23 the error of y is {amplified[23]:.0f} times that of the kernel, which applies to f and B y, of which N sees "
         f"{passed['sources']:.0f} in the mean; the active sets pass on {passed['y']:.1f} times of it into y"),
        ("Fig. 4.4: implicit Euler fails where M^h is no Z-matrix, the iteration does not", "; ".join(
            f"h = {fraction(r['h'])}: Euler reaches t = {r['euler_reaches']:g} with an error of {number(r['euler_error'])}, "
            f"largest off-diagonal entry {r['largest_off_diagonal']:.4f}" for r in euler)
         + ". Not seen: our data have a solution, and Euler finds it"),
        ("Fig. 4.6 left: sweeps do not depend on h", ", ".join(f"{r['sweeps_to_1e-12']} (h = {fraction(r['h'])})" for r in counts)
         + " to 1e-12. Agrees"),
        ("Fig. 4.6 right: the count 'somehow slightly increases' with 1/dx",
         f"from {right[0]['sweeps_to_tolerance']} at dx = {fraction(right[0]['dx'])} to {right[-1]['sweeps_to_tolerance']} at "
         f"{fraction(right[-1]['dx'])}: it doubles with 1/dx"),
        ("Figs. 4.7, 4.8: 5 iterations are sufficiently close at h = 0.01, dx = 1/40",
         f"at sweep 5 y errs by {number(errors[4])} of {size:.2f}, {100 * errors[4] / size:.1f} %, well seen in the sections of Fig. 4.8; "
         f"(4.8) asks for {number(membrane['tolerance_4_8'])} and is met at sweep {membrane['sweeps_to_4_8']}"),
        ("Fig. 4.9: what Euler has computed after 30 to 1200 s",
         "its first " + ", ".join(f"{100 * v:.2g}" for v in own["figure_4_9"]["shares"][:-1])
         + f" and {100 * own['figure_4_9']['shares'][-1]:.2g} % of the steps, by the times in the text"),
        ("Fig. 4.10, Table 4.1", "[times](#times)"),
        ("(5.1)-(5.2): nonlinear systems", "[nonlinear.md](../nonlinear.md)"),
    ]
    return table(["the paper", "here"], claims)


def literal_places(data):
    """The paper to the letter on one core, on all, and on a device, beside marching."""
    rows = data["rows"]
    sizes = sorted({(r["Q"], r["steps"]) for r in rows})
    lines = []
    for Q, J in sizes:
        for method, P in (("contour-literal", 25), ("contour-literal", 64), ("contour", None), ("march", None)):
            at = {r["place"]: r for r in pick(rows, Q=Q, steps=J, method=method, literal_nodes=P)}
            time = lambda place: seconds(at[place]["seconds"]["median"]) if place in at else "-"
            sweeps = seconds(at["device"]["sweeps_seconds"]) if P else "-"
            lines.append((f"{Q:g}", J, f"`{method}`" + (f", P = {P}" if P else ""), time("one core"), time("all cores"),
                          time("device"), sweeps, number(at["device"]["error_max"])))  # fmt: skip
    header = ("Q", "J", "method", "one core", "all cores", "device", "in sweeps there", "error of y")
    return [*table(header, lines), "", f"{data['parameters']['device']}; {evidence.origin(data)}."]


def case_one(paper):
    """Table 4.1, Case I: shares of the time at dx = 1/40."""
    printed = {16: (47.5, 35.7, 4.5, 12.3), 32: (48.8, 34.7, 4, 12.5), 64: (46.1, 39.5, 4.3, 10.1), 128: (42.8, 42.4, 4.1, 10.7),
               256: (35.6, 50.7, 4, 9.7), 512: (32.0, 53.7, 4.1, 10.2)}
    device = evidence.sweeps_of_table()
    rows = []
    for J, shares in printed.items():
        r = next(r for r in paper["rows"] if r["figure"] == "4.10" and r.get("split_percent") and r["contestant"] == "contour, to (4.8)"
                 and abs(r["h"] * J - 1) < 1e-9 and abs(r["dx"] * 40 - 1) < 1e-9)
        s = r["split_percent"]
        rows.append([fraction(1 / J), " / ".join(f"{v:g}" for v in shares),
                     " / ".join(f"{s[k]:.0f}" for k in ("lcp", "convolution", "transform", "setup", "other")),
                     *(split_of_sweep(one) for one in device if one["Q"] == 39 and one["steps"] == 4 * J)])
    return table(["h (dx = 1/40)", "the paper, GPU: LCP / linear algebra / interpolation / communication, %",
                  "here, CPU: LCP / convolution / transform / set-up / other, %",
                  *(["a sweep here, GPU: LCP / transforms and scan / the rest, %"] if device else [])], rows)


def split_of_sweep(row):
    """The parts are timed alone, so that their sum may exceed the sweep: shares are of the larger of the two."""
    rest = max(0.0, row["other"])
    whole = row["seconds"]["median"] + max(0.0, -row["other"])
    lcp = row["lcp"]["median"]
    return f"{100 * lcp / whole:.0f} / {100 * (whole - lcp - rest) / whole:.0f} / {100 * rest / whole:.0f}"


def galerkin_claims(data):
    """Wang and Chen."""
    rows = data["rows"]
    ratios = evidence.load("galerkin-ratios")["rows"]
    off_kinks = [r for r in ratios if r["steps"] != 9426]
    bridge = [r for r in pick(rows, part="eigenvalue", scene="bridge") if r["lambda"] == 0]
    longest = max(r["T"] for r in bridge)
    monotone = max((r for r in bridge if r["T"] == longest), key=lambda r: r["steps"])["smallest"]
    matrix = evidence.load("papers")["printed_matrix"]
    order = lambda scene, grid, method, norm: first(rows, part="order", scene=scene, grid=grid, method=method)["order"][norm]
    values = {r["T"]: r["smallest"] for r in rows if r["part"] == "eigenvalue" and r["as_printed"] and r["scene"] == "nash-game"
              and r["regularisation"] == 0.1 and r["steps"] == max(q["steps"] for q in rows if q["part"] == "eigenvalue" and q["as_printed"] and q["T"] == r["T"])}
    off = [r["continuous"] / r["discontinuous"] for r in pick(rows, part="projection", scene="bridge", grid="kinks off nodes")]
    claims = [
        ("Theorem 4.1: order 1 under strong monotonicity", f"order {order('bridge', 'kinks on nodes', 'galerkin', 'y_L2'):.2f} for u with "
         f"kinks on nodes, {order('bridge', 'kinks off nodes', 'galerkin', 'y_L2'):.2f} off them. It does not apply: the operator of our bridge "
         f"is not strongly monotone on [0, 3π], its smallest eigenvalue is {monotone:.2f}; the paper's is"),
        ("Fig. 2: slopes about 2 for x and u", f"x {order('bridge', 'kinks on nodes', 'galerkin', 'x_L2'):.2f}, u "
         f"{order('bridge', 'kinks on nodes', 'galerkin', 'y_L2'):.2f} on nodes; {order('bridge', 'kinks off nodes', 'galerkin', 'x_L2'):.2f} and "
         f"{order('bridge', 'kinks off nodes', 'galerkin', 'y_L2'):.2f} off nodes"),
        ("Fig. 3: Euler's x(T) has slope 0.923", f"{order('bridge', 'kinks on nodes', 'euler', 'x_at_T'):.2f}"),
        ("Example 5.1, h = 1e-3: Euler over Galerkin 2.36e3 (x(T)), 2.22e7 (x), 2.16e6 (u)",
         "with " + "; ".join(f"{r['steps']} steps {number(r['x_at_T'])}, {number(r['x_L2'])} and {number(r['y_L2'])}" for r in ratios)
         + ". 3π/1e-3 is 9424.8, and kinks of u lie on time points with 9426 steps alone. Off the kinks more than it prints for x(T), "
         f"{min(r['x_at_T'] for r in off_kinks) / 2.36e3:.0f} to {max(r['x_at_T'] for r in off_kinks) / 2.36e3:.0f} times, and less for x and u, "
         f"by {2.22e7 / max(r['x_L2'] for r in off_kinks):.0f} to {2.16e6 / min(r['y_L2'] for r in off_kinks):.0f} times. The data of the bridge are not the paper's"),
        ("Fig. 3 lower: discontinuous functions far better than continuous ones",
         f"best approximations of y off nodes: continuous ones are {min(off):.2f} to {max(off):.2f} times as far. Not far better"),
        ("Fig. 5: Euler on the game, order about 0", f"{order('nash-game', 'kinks off nodes', 'euler', 'y_L2'):.2f}. Not seen"),
        ("Example 5.2: order 1.0076 for u", f"{order('nash-game', 'kinks off nodes', 'galerkin', 'y_L2'):.2f} with the correct matrix. With "
         "the matrix as printed errors do not converge to zero: u in L2 "
         + "; ".join(f"`{name}` " + ", ".join(f"{r['printed']:.2f} ({r['steps']} steps)" for r in pick(matrix, scene=name))
                     + f", where the correct one has {number(pick(matrix, scene=name)[-1]['correct'])}" for name in ("nash-game", "bridge"))
         + " (`scripts/paper_claims`)"),
        ("Example 5.2: the game as a mixed problem with 18 N unknowns", "[nash-game-mixed.toml](../../examples/nash-game-mixed.toml), with "
         "a prescribed solution"),
        ("Fig. 6: an indefinite operator at T = 1 and 0.5", "smallest eigenvalue with the printed matrix "
         + ", ".join(f"{values[T]:.3f} (T = {T:g})" for T in sorted(values, reverse=True)) + ": indefinite at T = 1 only. With the "
         "correct matrix it is 0.1 at every T"),
    ]
    return table(["the paper", "here"], claims)


def off_in_first(entry, kind):
    """The largest error of the first state at the time points of a curve, of its largest value; the exact curve by lines."""
    t, x = entry["exact"]["t"], entry["exact"]["x"][0]
    worst = 0.0
    for at, value in zip(entry[kind]["t"], entry[kind]["x"][0]):
        k = min(max(bisect.bisect_right(t, at), 1), len(t) - 1)
        worst = max(worst, abs(value - x[k - 1] - (x[k] - x[k - 1]) * (at - t[k - 1]) / (t[k] - t[k - 1])))
    return worst / max(map(abs, x))


def goal_claims(data):
    """Bartel and Schaller."""
    rows, figures = data["rows"], data["details"]["figures"]
    right = lambda scene, contestant, steps: first(rows, scene=scene, contestant=contestant, steps=steps)["violation_right"]
    near = lambda scene, contestant, steps: min(pick(rows, scene=scene, contestant=contestant), key=lambda r: abs(r["steps"] - steps))
    uniform, adapted = near("ph-toy", "euler, uniform", 200), near("ph-toy", "euler, goal", 200)
    free = lambda scene: ", ".join(
        f"{right(scene, 'euler, goal', n):.3f} and {right(scene, 'midpoint, uniform', n):.3f} with {n} steps" for n in (25, 50))
    ladder = [r for r in rows if r["scene"] == "ladder" and r["contestant"] in ("euler, uniform", "euler, goal") and r["steps"] == 200]
    claims_of_goal = evidence.load("goal-claims")
    exact_6, jacobi_6 = (pick(claims_of_goal["figure_6"], adjoint=how) for how in ("exact", "jacobi:1"))
    words = {"uniform": "equal steps", "loc": "I_loc", "loc+10": "weighted"}
    first_coordinate = {entry["name"].split(",")[0]: {kind: off_in_first(entry, kind) for kind in ("goal", "uniform")} for entry in figures["ladder"]}
    jacobi = lambda steps: (first(rows, scene="ph-toy", contestant="euler, goal, block-Jacobi 1", steps=steps)["I_loc"]
                            / first(rows, scene="ph-toy", contestant="euler, goal", steps=steps)["I_loc"])
    claims = [
        ("Fig. 2: grids for I_loc need fewer steps", f"`ph-toy`, 200 steps: I_loc {number(uniform['I_loc'])} uniform, "
         f"{number(adapted['I_loc'])} adapted. Agrees. With block-Jacobi the violation by right ends saturates at that of SciPy's BDF, as printed: "
         f"{right('ph-toy', 'euler, goal, block-Jacobi 1', 800):.2f} and {first(evidence.load('goal-peers')['rows'], scene='ph-toy', contestant='scipy BDF', steps=800)['violation_right']:.2f} "
         f"at 800 steps, {right('ph-toy', 'euler, goal', 800):.2f} by the exact adjoint"),
        ("Fig. 4, u = 0: adapted Euler against midpoint, violation by right ends",
         f"Euler and midpoint: {free('ph-toy, u = 0')}. Agrees: they cross in between"),
        ("Fig. 4, 0.6 R", f"{free('ph-toy, u = 0, 0.6 R')}: midpoint is ahead. Agrees"),
        ("Figs. 5, 6, the ladder: the adapted grid is better", "I_loc with 200 steps: "
         + ", ".join(f"{number(r['I_loc'])} ({r['contestant']})" for r in ladder)
         + "; with the settings of the tables it is not, with 20 cycles and other marking it is (appendix). With the "
         "paper's indicator (4.4), 20 cycles from 20 steps and Dörfler's marking of "
         + ", ".join(f"{r['marking']}" for r in exact_6) + " I_loc is "
         + ", ".join(f"{r['I_loc'] / r['I_loc_uniform']:.2f}" for r in exact_6) + " times that of equal steps by the exact adjoint and "
         + ", ".join(f"{r['I_loc'] / r['I_loc_uniform']:.2f}" for r in jacobi_6) + " by one sweep of block-Jacobi. Not in general"),
        ("Fig. 6: a mismatch of the first coordinate that more cycles reduce", "largest error of e0, of its largest value: "
         + ", ".join(f"{100 * off['goal']:.1f} % ({name})" for name, off in first_coordinate.items())
         + f", with equal steps {100 * first_coordinate['20 cycles']['uniform']:.1f} %. Agrees; equal steps are better still"),
        ("Fig. 3: with I_loc + 10 ∫ x·x trajectories are better and the balance is worse", "`ph-toy`, 200 steps, x in L2 and I_loc: "
         + ", ".join(f"{r['error_L2']:.2f} and {number(r['I_loc'])} ({words[r['quantity']]})" for r in claims_of_goal["figure_3"])
         + ". Agrees; in x equal steps are as good"),
        ("block-Jacobi: one or few sweeps approximate the adjoint",
         f"relative error after 1 and 8 sweeps, 200 steps: {first(figures['saturation'], variant=1.0, steps=200)['error_1']:.2f} and "
         f"{first(figures['saturation'], variant=1.0, steps=200)['error_8']:.2f}. No approximation here; its grids have "
         f"{jacobi(200):.1f} times the I_loc of those of the exact adjoint at 200 steps and {jacobi(800):.1f} times at 800"),
        ("Outlook: midpoint, exponential schemes, switching", "done: [goal.md](../goal.md). Multirate steps are measured below, and not "
         "part of the solver; other Green's functions are not there"),
    ]
    return table(["the paper", "here"], claims)


def multirate(data):
    """Errors at equal work, and what equal errors cost: the error of midpoint steps falls with the square of the work."""
    lines = []
    for cells, groups in ((5, 4), (20, 5), (20, 20)):
        found = [r for r in data["rows"] if r["cells"] == cells and r["groups"] in (1, groups)]
        for at in (1, 3):
            own = pick(found, kind="own grids")[at]
            uniform, one = (pick(found, kind=kind)[at] for kind in ("uniform", "one grid"))
            gain, apart = math.sqrt(one["error_L2"] / own["error_L2"]), own["steps"]
            lines.append((cells, groups, own["updates"], uniform["steps"][0], number(uniform["error_L2"]), number(one["error_L2"]),
                          number(own["error_L2"]), f"{gain:.1f}", f"{apart[0]}, {apart[1]}, ..., {apart[-1]}"))
    return table(["cells", "groups", "updates of states", "steps of one grid", "error: equal steps", "one grid", "own grids",
                  "times fewer updates for the error of one grid", "steps of the groups"], lines)


def lost_to_march(ways):
    """In how many rows of the dense scenes a way over all time points loses to `march`, and by how much."""
    march = {(r["scene"], r["steps"]): r["seconds"] for r in ways if r["method"] == "march"}
    lines = []
    for method in ("iteration", "newton", "pointwise"):
        ratios = [r["seconds"] / march[r["scene"], r["steps"]] for r in ways if r["method"] == method and (r["scene"], r["steps"]) in march]
        slower = [ratio for ratio in ratios if ratio > 1]
        lines.append(f"- `{method}` takes longer than `march` in {len(slower)} of {len(ratios)} of these cases, by {min(slower):.1f} to {max(slower):.0f} times.")
    return lines


def nonlinear(data):
    lines = ["Order: the error of x at T (of y in surface-reaction) against SciPy, four grids each, and that of the last two:", ""]
    names = sorted({r["scene"] for r in data["orders"]})
    rows = []
    for name in names:
        found = sorted(pick(data["orders"], scene=name), key=lambda r: r["steps"])
        rows.append([name, *(f"{number(r['error'])} ({r['steps']})" for r in found),
                     f"{math.log2(found[-2]['error'] / found[-1]['error']):.1f}",
                     f"{math.log2(found[0]['error'] / found[-1]['error']) / (len(found) - 1):.1f}"])
    lines += table(["scene", *["error (steps)"] * 4, "last order", "mean order"], rows)
    lines += ["", "The ways to the same discrete solution; the difference from march is relative to the largest value:", ""]
    rows = [[r["scene"], r["steps"], r["method"], r["newton"], r["linear_solves"], r["windows"], r["marched"],
             f"{r['contraction']:.2f}", "-" if r["method"] == "march" else number(r["from_march"]), seconds(r["seconds"])]
            for r in data["ways"]]
    lines += table(["scene", "steps", "method", "Newton", "linear solves", "windows", "marched", "contraction", "from march", "time"], rows)
    lines += ["", *lost_to_march(data["ways"]), "", "A stronger nonlinearity:", ""]
    rows = []
    for r in pick(data["stiffness"], method="march"):
        both = [first(data["stiffness"], scene=r["scene"], value=r["value"], method=m) for m in ("iteration", "newton")]
        rows.append([r["scene"], f"{r['parameter']} = {r['value']:g}", r["newton"],
                     *(f"{b['linear_solves']} in {b['windows']}" if b["status"] == "solved" else b["status"] for b in both)])
    lines += table(["scene", "", "march: Newton", "iteration: linear solves in windows", "newton: the same"], rows)
    lines += ["", "- Shockley's diode and the ideal one, largest difference of v: "
              + ", ".join(f"{r['from_ideal']:.3f} (V = {r['V']:.4f})" for r in data["limit"]) + "."]
    lines += [f"- Linear scenes with a phi that is 0, {r['scene']}, {r['method']} beside {r['linear_method']}: {number(r['from_linear'])} "
              f"apart, {r['seconds'] / r['linear_seconds']:.1f} times the time." for r in data["linear_scenes"]]
    lines += [f"- surface-reaction, Q = {r['Q']}, {r['states']} states, {r['steps']} steps, {r['method']}: {r['status']}, {r['linear_solves']} linear solves in "
              f"{r['windows'] + r['marched']} windows, contraction {r['contraction']:.2f}, residual {number(r['residual'])}, {seconds(r['seconds'])}."
              for r in data["large"]]
    shared = " that were shared while this was measured: times are indicative" if data.get("shared", "note" in data) else ""
    lines += ["", f"{data['machine']['cores']} cores{shared}, errors as in the table of orders on the same steps. Commit {data['commit'][:9]}."]
    return lines


def nonlinear_device(data):
    rows = data["rows"]
    lines = []
    ways = [("iteration", "cuda", "iteration, H200"), ("iteration by marches", "cpu", "iteration by marches, one core"),
            ("march", "cpu", "march, one core"), ("one linear march", "cpu", "one linear march, one core")]
    cells, best = [], {}
    for steps in sorted({r["steps"] for r in rows}):
        for name, backend, said in ways:
            for r in pick(rows, contestant=name, backend=backend, steps=steps):
                cells.append([steps, said, f"{r['tolerance']:.0e}" if "tolerance" in r else "", r.get("linear_solves", 1),
                              number(r["error"]) if "error" in r else "-", seconds(r["seconds"]["median"])])
                best.setdefault((steps, name), []).append(r)
    lines += table(["steps", "way", "to", "linear solves", "error of y", "whole solve"], cells)
    reached = min(r["steps"] for r in rows if r.get("error", 1) <= 1e-4)
    for steps in sorted({reached, max(r["steps"] for r in rows)}):
        device, host, linear = (min(r["seconds"]["median"] for r in best[steps, name])
                                for name in ("iteration", "iteration by marches", "one linear march"))
        error = best[steps, "iteration"][0]["error"]
        lines += ["" if steps == reached else None,
                  f"- {steps} steps, error {number(error)}: {host / device:.1f} times faster than marching on one core; one linear march takes "
                  f"{linear / device:.2f} of the time."]
    machine = data["machine"]
    lines = [one for one in lines if one is not None]
    return lines + ["", f"Q = {rows[0]['Q']}. Error {data['details']['error']}. {data['parameters']['device']} beside {machine['cpu']}, "
                    f"{machine['cores']} threads, {data['compiler']}, commit {data['commit'][:9]}, medians of {data['repeats']}, of one run above 3 s."]
