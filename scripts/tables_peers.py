"""The table of docs/measurements.md that comes from scripts/bench_peers."""
from evidence import machine, number, seconds


def no_less_accurate(row, than):
    return all(row[key] <= (1 + 1e-6) * than[key] for key in ("error_max", "trace_error_max"))


def fastest_as_accurate(rows, peer):
    able = [row for row in rows if row["contestant"].startswith("bromwich") and no_less_accurate(row, peer)]
    return min(able, key=lambda row: row["seconds"]["median"], default=None)


def ratio_text(ratio):
    return f"{ratio:.3g}" if ratio < 1000 else f"{float(f'{ratio:.2g}'):.0f}"


def peers(data):
    """The finest rung of every variant of Siconos beside the fastest run of bromwich that is no less accurate."""
    lines = ["| scene | Siconos | steps | error of y | of N x | time | bromwich, at errors no larger | time | Siconos / bromwich |"]
    lines.append("|--" * 9 + "|")
    timed = [row for row in data["rows"] if row["status"] == "solved" and row["seconds"]]
    finest = {}
    for row in timed:
        if row["contestant"].startswith("Siconos"):
            finest[(row["scene"], row["contestant"], row["method"])] = row
    for (scene, contestant, method), peer in finest.items():
        here = [row for row in timed if row["scene"] == scene]
        best = fastest_as_accurate(here, peer)
        name = f"{contestant.removeprefix('Siconos ')}; {method}"
        cells = [scene, name, peer["steps"], number(peer["error_max"]), number(peer["trace_error_max"]), seconds(peer["seconds"]["median"])]
        if best:
            ratio = peer["seconds"]["median"] / best["seconds"]["median"]
            ours = f"{best['contestant'].removeprefix('bromwich ')}, {best['steps']} steps, {best['threads']} threads"
            cells += [ours, seconds(best["seconds"]["median"]), f"**{ratio_text(ratio)}**" if ratio < 1 else ratio_text(ratio)]
        else:
            cells += ["none as accurate", "-", "-"]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    worst = max(row["difference_from_euler"] or 0 for row in data["rows"])
    lost = [note.removeprefix("bromwich loses: ") for note in data["notes"] if note.startswith("bromwich loses: ")]
    lines += ["", "Below 1 (bold): bromwich loses. Of all rungs it loses:" if lost else "bromwich loses none of these comparisons.", ""]
    lines += ["- " + note for note in lost]
    return lines + [
        "",
        f"{data['details']['siconos']}. Its implicit Euler method and ours give the same y and N x on the same grids, to {number(worst)}; "
        f"theta = gamma = 0.5: {data['details']['theta'].removeprefix('theta = gamma = 1/2 ')}. {machine(data)}, fresh processes taking "
        f"turns, median of {data['repeats']} repeats (of {min(row['repeats'] for row in data['rows'] if row['contestant'].startswith('Siconos'))} "
        "at least where one run takes seconds).",
    ]


def headline(data):
    """Siconos at its best and as its users run it, on the finest Signorini scene, for the README."""
    timed = [row for row in data["rows"] if row["status"] == "solved" and row["seconds"]]
    scene = [row["scene"] for row in timed if row["scene"].startswith("signorini")][-1]
    here = [row for row in timed if row["scene"] == scene]
    ratios = []
    for row in here:
        if row["contestant"].startswith("Siconos"):
            best = fastest_as_accurate(here, row)
            if best:
                ratios.append((row["seconds"]["median"] / best["seconds"]["median"], row))
    (low, nearest), (high, farthest) = min(ratios, key=lambda r: r[0]), max(ratios, key=lambda r: r[0])
    name = lambda row: f"{row['contestant'].removeprefix('Siconos ')}, {row['method'].replace('gamma = ', '').replace('theta = 0.5', 'theta = 1/2')}"
    return [
        f"- {scene.replace('signorini, ', 'Against Siconos, ')}, errors of y and N x no larger: **{ratio_text(low)}** (its best: {name(nearest)}) to "
        f"**{ratio_text(high)}** times as fast ({name(farthest)})."
    ]
