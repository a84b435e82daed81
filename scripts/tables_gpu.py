"""The tables of docs/measurements/gpu.md."""
from evidence import load, machine, number, seconds, sweeps_of_table


def spread_of(row, key):
    """Median of an operation that not every run measures."""
    return seconds(row[key]["median"]) if row.get(key) else ""


def gpu_sweeps(data):
    lines = ["| Q | J | one sweep | as a graph | LCP, warm | of copy | sine transform | of DGEMM | scan | FFT | an array up, down |", "|--" * 11 + "|"]
    for row in data["rows"]:
        if row["part"] != "sweep":
            continue
        cells = [f"{row['Q']:g}", row["steps"], spread_of(row, "seconds"), spread_of(row, "recorded"), spread_of(row, "lcp")]
        cells += [f"{100 * row['lcp_of_copy']:.0f} %", spread_of(row, "transform"), f"{100 * row['transform_of_gemm']:.0f} %"]
        cells += [spread_of(row, "scan"), spread_of(row, "fft"), f"{spread_of(row, 'upload')} {spread_of(row, 'download')}".strip()]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


# Table 4.1, Case II, of the paper (h = 0.01): by 1/dx the shares of LCP, linear algebra, interpolation and communication, %.
printed_case_two = {16: (46.9, 37.9, 4.5, 10.7), 32: (46.1, 37.3, 4.7, 11.9), 64: (49.3, 34.1, 5.1, 14.2),
                    128: (40.1, 40.2, 6.3, 13.4), 256: (30.2, 51.7, 6.6, 11.5), 512: (22.8, 56.8, 7, 13.4)}


def case_two():
    """{1/dx: the sweep here} for the columns that are measured."""
    rows = {round(row["Q"]) + 1: row for row in sweeps_of_table() if row["steps"] == 400}
    return {cells: rows[cells] for cells in printed_case_two if cells in rows}


def gpu_splits():
    """Table 4.1 of the paper beside the same split here; there is no interpolation in a sweep. The parts are timed alone,
    so that their sum may exceed the sweep: shares are of the larger of the two."""
    lines = ["", "| dx | the paper: LCP, linear algebra, interpolation, communication | here: LCP, transforms and scan, the rest |", "|--" * 3 + "|"]
    for cells, here in case_two().items():
        whole = here["seconds"]["median"] + max(0.0, -here["other"])
        lcp, rest = here["lcp"]["median"] / whole, max(0.0, here["other"]) / whole
        split = ", ".join(f"{share:g} %" for share in printed_case_two[cells])
        lines.append(f"| 1/{cells} | {split} | {100 * lcp:.0f} %, {100 * (1 - lcp - rest):.0f} %, {100 * rest:.0f} % |")
    return lines


def grid_errors():
    """{(Q, steps, method): the error of y of that grid}, computed once on a processor."""
    return {(row["Q"], row["steps"], row["method"]): row["error_max"] for row in load("grid-errors")["rows"]}


def error_of(row, grids):
    """Measured with the run, or that of its grid; sweeps to (4.8) stop at min(h, dx^2)/50, T = 4."""
    if row.get("error_max"):
        return number(row["error_max"])
    Q, steps = round(row["Q"]), row["steps"]
    known = grids.get((Q, steps, "euler" if row["contestant"].startswith("euler") else "march"))
    if known is None:
        return ""
    stop = min(4 / steps, 1 / (Q + 1) ** 2) / 50
    return f"<= {number(known + stop)}" if "(4.8)" in row["contestant"] else number(known)


def gpu_solves(data):
    lines = ["", "| Q | J | method | sweeps | set-up | iterations or steps | in sweeps alone | total | error of y |", "|--" * 9 + "|"]
    grids = grid_errors()
    for row in data["rows"]:
        if row["part"] != "solve":
            continue
        time, sweeps = row["seconds"], row.get("sweeps_seconds")
        cells = [f"{row['Q']:g}", row["steps"], row["contestant"], row["iterations"] or "", seconds(time["setup"]), seconds(time["solve"])]
        cells += [seconds(sweeps) if sweeps else "", seconds(time["median"]), error_of(row, grids)]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def gpu_again(data):
    return [
        *gpu_solves(data),
        "",
        f"{data['parameters']['device']} beside {machine(data)}, median of up to {data['repeats']} repeats.",
    ]


def gpu_operations(data):
    transforms = [row for row in data["rows"] if row["part"] == "transform"]
    lines = []
    if transforms:
        lines += ["", "| points | product, of DGEMM | cuFFT |", "|--" * 3 + "|"]
    for row in transforms:
        lines.append(f"| {row['n']} | {seconds(row['product'])}, {100 * row['product_of_gemm']:.0f} % | {seconds(row['fft'])} |")
    return lines


def lcp(data):
    """Batches of dense problems: a row for each size, problems a second for each matrix and start."""
    starts = [("dominant", "warm"), ("dominant", "cold"), ("random", "warm"), ("random", "cold"), ("semidefinite", "cold")]
    rates = {(row["n"], row["matrix"], row["start"]): row["problems_per_second"] for row in data["rows"] if row["part"] == "small problems"}
    lines = ["", "| n | " + " | ".join(f"{matrix}, {start}" for matrix, start in starts) + " |", "|--" * (len(starts) + 1) + "|"]
    for n in sorted({n for n, _, _ in rates}):
        cells = [f"{rates[n, *start]:.1e}" if (n, *start) in rates else "" for start in starts]
        lines.append(f"| {n} | " + " | ".join(cells) + " |")
    return [*lines, "", f"Problems a second, {data['parameters']['device']}, median of {data['repeats']} repeats."]


def gpu_quotes(data):
    quotes = [row for row in data["rows"] if row["part"] == "paper, Fig. 4.10"]
    times = "; ".join(f"dx = {row['dx']:.3g}: iteration {row['iteration_seconds'] / 60:g} min, implicit Euler {row['euler_seconds'] / 60:g} min" for row in quotes)
    return f" The paper's text on its Fig. 4.10, h = 0.01: {times}." if quotes else ""


def gpu(data):
    device = data["parameters"]
    return [
        *gpu_sweeps(data),
        *gpu_splits(),
        *gpu_solves(data),
        *gpu_operations(data),
        "",
        f"{device['device']}: copies {device['copy_bytes_per_second'] / 1e12:.2f} TB/s, DGEMM {device['gemm_flops_per_second'] / 1e12:.1f} Tflop/s "
        f"in this run; a sweep is two sine transforms, a scan and the batch of problems with its report. Beside it {data['threads']} threads of "
        f"{machine(data)}, median of up to {data['repeats']} repeats.{gpu_quotes(data)}",
    ]
