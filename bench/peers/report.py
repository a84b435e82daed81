"""Errors, rows and sentences of scripts/bench_peers."""
import datetime
import os
import pathlib
import re
import subprocess

import numpy as np


def late(scene, steps):
    return scene.T * np.arange(1, steps + 1) / steps >= scene.T / 16


def largest_difference(y, reference):
    """Relative to max(1, largest |y|)."""
    return float(np.max(np.abs(y - reference)) / max(1, np.max(np.abs(reference))))


def errors(scene, y, x, reference):
    """Of y and of the trace N x, over all constraints and t >= T/16."""
    keep = late(scene, len(y))
    differences = {"error": y - reference[0], "trace_error": scene.trace(x - reference[1])}
    result = {}
    for name, difference in differences.items():
        result[name + "_max"] = float(np.max(np.abs(difference[keep])))
        result[name + "_rms"] = float(np.sqrt(np.mean(difference[keep] ** 2)))
    return result


no_errors = {f"{name}_{norm}": None for name in ("error", "trace_error") for norm in ("max", "rms")}


def time_text(value):
    for unit, factor in (("s", 1), ("ms", 1e3)):
        if value * factor >= 1:
            return f"{value * factor:.3g} {unit}"
    return f"{value * 1e6:.3g} µs"


def ratio_text(ratio):
    return f"{ratio:.3g} x" if ratio < 1000 else f"{ratio:.1e} x"


def row_text(row):
    method = "" if row["method"] in row["contestant"] else f"{row['method']}, "
    return f"{row['contestant']} ({method}{row['steps']} steps)"


def no_less_accurate(row, than):
    """Rounded to six digits: the same scheme on the same grid differs by rounding."""
    return all(row[name] <= (1 + 1e-6) * than[name] for name in ("error_max", "trace_error_max"))


def compare(row, bromwich):
    """One sentence for a row of Siconos, and its time divided by that of bromwich at errors no larger; 0 if none."""
    where = f"{row['scene']}, error of y {row['error_max']:.1e}, of N x {row['trace_error_max']:.1e}: "
    time = time_text(row["seconds"]["median"])
    able = [other for other in bromwich if no_less_accurate(other, row)]
    if not able:
        return where + f"{row_text(row)} takes {time}; no bromwich row has errors as small", 0
    best = min(able, key=lambda other: other["seconds"]["median"])
    ratio = row["seconds"]["median"] / best["seconds"]["median"]
    threads = f"{best['threads']} thread" + ("s" if best["threads"] > 1 else "")
    text = (
        f"{best['contestant']} with {best['steps']} steps on {threads} takes "
        f"{time_text(best['seconds']['median'])}, {row_text(row)} {time}: {ratio_text(ratio)}"
    )
    return where + text, ratio


def comparisons(timed):
    """All sentences of compare(), then the extremes per scene, then the cases that bromwich loses."""
    sentences, extremes, losses = [], [], []
    for scene in dict.fromkeys(row["scene"] for row in timed):
        here = [row for row in timed if row["scene"] == scene]
        peers = [row for row in here if row["contestant"].startswith("Siconos")]
        bromwich = [row for row in here if row["contestant"].startswith("bromwich")]
        results = [(*compare(row, bromwich), row_text(row)) for row in peers]
        sentences += [sentence for sentence, _, _ in results]
        losses += ["bromwich loses: " + sentence for sentence, ratio, _ in results if ratio < 1]
        ranked = sorted((ratio, text) for _, ratio, text in results if ratio > 0)
        if ranked:
            (low, nearest), (high, farthest) = ranked[0], ranked[-1]
            extremes.append(
                f"{scene}: at errors no larger, the time of Siconos over that of bromwich is {ratio_text(low)} for "
                f"{nearest} to {ratio_text(high)} for {farthest}"
            )
    return sentences + extremes + (losses or ["bromwich loses none of these comparisons"])


def endings(rows):
    """The rows that are not solved, one sentence per contestant."""
    steps = {}
    for row in rows:
        if row["status"] != "solved":
            place = (row["scene"], row["contestant"], row["status"])
            steps.setdefault(place, set()).add(row["steps"])
    return [
        f"{scene}: {contestant} ({', '.join(str(number) for number in sorted(numbers))} steps) ends as {status}"
        for (scene, contestant, status), numbers in steps.items()
    ]


def notes(rows, references):
    timed = [row for row in rows if row["seconds"] is not None and row["status"] == "solved"]
    worst = max((row["difference_from_euler"] or 0 for row in rows), default=0)
    agreement = f"Siconos with theta = 1 and bromwich euler on the same grids differ by {worst:.1e} at most"
    return [*comparisons(timed), *endings(rows), agreement, *references]


def cpu_model():
    found = re.search(r"model name\s*:\s*(.*)", pathlib.Path("/proc/cpuinfo").read_text())
    return found.group(1) if found else "unknown"


def build_facts(bromwich):
    """compiler, build_type, flags, commit and version, from `bromwich info`."""
    text = subprocess.run([str(bromwich), "info"], capture_output=True, text=True, check=True).stdout
    fact = {line.split(maxsplit=1)[0]: line.split(maxsplit=1)[1].strip() for line in text.splitlines() if " " in line}
    version, _, commit = fact["version"].partition(" (commit ")
    compiler, _, build_type = fact["compiler"].rpartition(", ")
    return {
        "compiler": compiler,
        "build_type": build_type,
        "flags": fact["flags"],
        "commit": commit.rstrip(")"),
        "version": version,
    }


def envelope(bromwich, scenes, threads, repeats, quick, details, rows, sentences):
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "schema": "bromwich-bench/1",
        "bench": "peers",
        "scene": "; ".join(scene.label for scene in scenes),
        "parameters": {},
        "machine": {"cpu": cpu_model(), "cores": threads, "memory": memory},
        **build_facts(bromwich),
        "threads": threads,
        "repeats": repeats,
        "quick": quick,
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "details": details,
        "rows": rows,
        "notes": sentences,
    }
