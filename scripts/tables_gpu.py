"""The tables of docs/measurements/gpu.md."""
from evidence import machine, number, seconds, sweeps_of_table


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


def gpu_splits(data):
    """Table 4.1 of the paper beside the same split here; there is no interpolation in a sweep. The parts are timed alone,
    so that their sum may exceed the sweep: shares are of the larger of the two."""
    paper = [row for row in data["rows"] if row["part"] == "paper, Table 4.1"]
    if not paper:
        return []
    lines = ["", "| dx | the paper: LCP, linear algebra, interpolation, communication | here: LCP, transforms and scan, the rest |", "|--" * 3 + "|"]
    ours = {round(row["Q"]) + 1: row for row in [*data["rows"], *sweeps_of_table()] if row["part"] == "sweep" and row["steps"] == 400}
    for row in paper:
        here = ours.get(row["cells"]) or ours[40]
        sweep = here["seconds"]["median"]
        whole = sweep + max(0.0, -here["other"])
        lcp, rest = here["lcp"]["median"] / whole, max(0.0, here["other"]) / whole
        dx = f"1/{row['cells']}" if row["cells"] in ours else f"1/{row['cells']} (here 1/40)"
        split = ", ".join(f"{row[key]:g} %" for key in ("lcp", "linear_algebra", "interpolation", "communication"))
        lines.append(f"| {dx} | {split} | {100 * lcp:.0f} %, {100 * (1 - lcp - rest):.0f} %, {100 * rest:.0f} % |")
    return lines


def gpu_solves(data):
    lines = ["", "| Q | J | method | sweeps | set-up | iterations or steps | in sweeps alone | total | error of y |", "|--" * 9 + "|"]
    for row in data["rows"]:
        if row["part"] != "solve":
            continue
        time, sweeps, error = row["seconds"], row.get("sweeps_seconds"), row.get("error_max")
        cells = [f"{row['Q']:g}", row["steps"], row["contestant"], row["iterations"] or "", seconds(time["setup"]), seconds(time["solve"])]
        cells += [seconds(sweeps) if sweeps else "", seconds(time["median"]), number(error) if error else ""]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return lines


def gpu_operations(data):
    transforms = [row for row in data["rows"] if row["part"] == "transform"]
    small = [row for row in data["rows"] if row["part"] == "small problems"]
    lines = []
    if transforms:
        lines += ["", "| points | product, of DGEMM | cuFFT |", "|--" * 3 + "|"]
    for row in transforms:
        lines.append(f"| {row['n']} | {seconds(row['product'])}, {100 * row['product_of_gemm']:.0f} % | {seconds(row['fft'])} |")
    if small:
        lines += ["", "| n | problems a batch | problems/s, warm | of copy |", "|--" * 4 + "|"]
    for row in small:
        lines.append(f"| {row['n']} | {row['rows']} | {row['problems_per_second']:.2e} | {100 * row['of_copy']:.0f} % |")
    return lines


def gpu_quotes(data):
    quotes = [row for row in data["rows"] if row["part"] == "paper, Fig. 4.10"]
    times = "; ".join(f"dx = {row['dx']:.3g}: iteration {row['iteration_seconds'] / 60:g} min, implicit Euler {row['euler_seconds'] / 60:g} min" for row in quotes)
    return f" The paper's text on its Fig. 4.10, h = 0.01: {times}." if quotes else ""


def gpu(data):
    device = data["parameters"]
    return [
        *gpu_sweeps(data),
        *gpu_splits(data),
        *gpu_solves(data),
        *gpu_operations(data),
        "",
        f"{device['device']}: copies {device['copy_bytes_per_second'] / 1e12:.2f} TB/s, DGEMM {device['gemm_flops_per_second'] / 1e12:.1f} Tflop/s "
        f"in this run; a sweep is two sine transforms, a scan and the batch of problems with its report. Beside it {data['threads']} threads of "
        f"{machine(data)}, median of up to {data['repeats']} repeats.{gpu_quotes(data)}",
    ]
