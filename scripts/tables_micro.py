"""Tables of bench/results/micro.json (scripts/bench_micro): what an operation reaches beside what the machine can do."""
import evidence

structures = {"lcp_tridiagonal": "tridiagonal", "lcp_dense": "dense"}
words = {
    "convolution_scan": "convolution, scan of exponentials",
    "convolution_fft": "convolution, FFT",
    "convolution_dense": "convolution, dense state stepped",
    "sine_transform": "sine transform",
    "resolvent_kronecker": "shifted solves, Kronecker sum",
    "resolvent_dense": "shifted solves, dense",
    "resolvent_sparse": "shifted solves, sparse",
    "march": "march",
}
rates = ("solves", "steps")


def scaled(value, unit=""):
    """84.1 M, 3.2 k: three digits and a decimal prefix."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}".strip()


def counter(row, name, unit=""):
    value = row["counters"].get(name)
    return "-" if value is None else scaled(value, unit)


def share(row):
    """47 % of memory."""
    if row["ceiling"] is None:
        return "-"
    percent = row["percent"][row["ceiling"]]
    return f"{percent:.0f} % of {row['ceiling']}" if percent >= 1 else "below 1 %"


def size_of(bytes_):
    for unit, factor in (("GiB", 2**30), ("MiB", 2**20), ("KiB", 2**10)):
        if bytes_ >= factor:
            return f"{bytes_ / factor:.3g} {unit}"
    return f"{bytes_:g} B"


def heading(*cells):
    return ["| " + " | ".join(cells) + " |", "|--" * len(cells) + "|"]


def line(*cells):
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def ceilings(data):
    streams, best = {}, {}
    for row in data["ceilings"]:
        name, counters = row["operation"], row["counters"]
        if "bytes_per_second" in counters:
            streams.setdefault(counters["footprint"], {})[name] = counter(row, "bytes_per_second", "B/s")
        else:
            value = counters.get("flops", counters.get("divisions"))
            best[name] = max(best.get(name, 0), value)
    lines = heading("arrays together", "copy", "triad", "update")
    sizes = sorted(streams)
    for size in sizes[::2] if len(sizes) % 2 else sizes[1::2]:
        cells = streams[size]
        lines.append(line(size_of(size), *(cells.get(name, "-") for name in ("copy", "triad", "update"))))
    numbers = f"GEMM {scaled(best['gemm'], 'flop/s')}, multiply-adds in registers {scaled(best['fma'], 'flop/s')}, "
    return lines + ["", numbers + f"divisions in registers {scaled(best['divide'], '/s')}."]


def complementarity(data):
    problems = {}
    for row in data["rows"]:
        if row["operation"] in structures:
            found = row["arguments"]
            kind = found["class"] + (", smooth" if "rows_are" in found else "")
            problems.setdefault((row["operation"], kind, found["n"], found["rows"]), {})[found["start"]] = row
    cold_cells = ("cold, problems/s", "sweeps", "ceiling")
    lines = heading("M", "class", "n", "rows", "warm, problems/s", "bytes/s", "flop/s", "ceiling", *cold_cells)
    for (operation, kind, n, rows), starts in sorted(problems.items(), key=lambda item: (item[0][0] == "lcp_dense", item[0][1:])):
        if set(starts) != {"warm", "cold"}:
            continue
        warm, cold = starts["warm"], starts["cold"]
        lines.append(
            line(structures[operation], kind, n, rows, counter(warm, "problems"), counter(warm, "bytes_per_second", "B/s"),
                 counter(warm, "flops", "flop/s"), share(warm), counter(cold, "problems"), counter(cold, "sweeps"), share(cold))
        )
    return lines


def arguments(row):
    """n = 39, J = 400; the recurrence of a march in front."""
    return ", ".join(value if isinstance(value, str) else f"{name} = {value}" for name, value in row["arguments"].items())


def others(data):
    lines = heading("operation", "size", "time", "rate, /s", "bytes/s", "flop/s", "ceiling")
    for row in data["rows"]:
        if row["operation"] not in words:
            continue
        rate = next((f"{counter(row, name)} {name}" for name in rates if name in row["counters"]), "-")
        lines.append(
            line(words[row["operation"]], arguments(row), evidence.seconds(row["seconds"]["median"]), rate,
                 counter(row, "bytes_per_second", "B/s"), counter(row, "flops", "flop/s"), share(row))
        )
    return lines


def goals(data):
    """The two batches that have a goal, the first against both ways to measure a stream."""
    copies = {row["counters"]["footprint"]: row for row in data["ceilings"] if row["operation"] == "copy"}
    lines = []
    for row in data["rows"]:
        found = row["arguments"]
        if found.get("class") != "P" or found.get("start") != "warm" or "rows_are" in found:
            continue
        if row["operation"] == "lcp_tridiagonal" and found["n"] == 511:
            nearest = min(copies, key=lambda footprint: abs(footprint - row["counters"]["footprint"]))
            of_copy = row["counters"]["bytes_per_second"] / copies[nearest]["counters"]["bytes_per_second"]
            lines.append(
                f"- Tridiagonal, n = 511, warm: {counter(row, 'problems')}problems/s, {counter(row, 'bytes_per_second', 'B/s')}. This is "
                f"{100 * of_copy:.0f} % of STREAM copy and {row['percent']['memory']:.0f} % of the fastest stream over arrays as large "
                f"({size_of(row['counters']['footprint'])}); as the batch does, it reads three arrays and writes one."
            )
        if row["operation"] == "lcp_dense" and found["n"] == 4:
            lines.append(f"- Dense, n = 4, warm: {counter(row, 'problems')}problems/s.")
    return lines


def micro(data):
    """Lines of Markdown: the ceilings, the batches of complementarity problems, all other operations."""
    note = (
        f"Median of {data['repeats']} repeats, randomly interleaved. Ceiling: the one that the row comes closest to, of memory (bytes/s "
        "of the fastest stream over arrays as large as those of the row), GEMM and divisions, all of this run. Warm: each call starts "
        f"from the solution, and confirms it; cold: from zero. {evidence.machine(data)}."
    )
    return goals(data) + [""] + ceilings(data) + [""] + complementarity(data) + [""] + others(data) + ["", note]
