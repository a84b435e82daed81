"""The table of docs/measurements/siconos.md that comes from scripts/bench_peers."""
from evidence import machine, number, origin, seconds


def no_less_accurate(row, than):
    return all(row[key] <= (1 + 1e-6) * than[key] for key in ("error_max", "trace_error_max"))


def fastest_as_accurate(rows, peer):
    able = [row for row in rows if row["contestant"].startswith("bromwich") and no_less_accurate(row, peer)]
    return min(able, key=lambda row: row["seconds"]["median"], default=None)


def ratio_text(ratio):
    return f"{ratio:.3g}" if ratio < 1000 else f"{float(f'{ratio:.2g}'):.0f}"


def peers(data):
    """Of every variant of Siconos the rung at which it does best against bromwich, beside the fastest run of bromwich that is
    no less accurate."""
    lines = ["| scene | Siconos | steps | error of y | of N x | time | bromwich, at errors no larger | time | Siconos / bromwich |"]
    lines.append("|--" * 9 + "|")
    timed = [row for row in data["rows"] if row["status"] == "solved" and row["seconds"]]
    closest = {}
    for row in timed:
        if not row["contestant"].startswith("Siconos"):
            continue
        best = fastest_as_accurate([other for other in timed if other["scene"] == row["scene"]], row)
        ratio = row["seconds"]["median"] / best["seconds"]["median"] if best else float("inf")
        place = (row["scene"], row["contestant"], row["method"])
        closest[place] = min(closest.get(place, (ratio, row)), (ratio, row), key=lambda pair: pair[0])
    for (scene, contestant, method), (_, peer) in closest.items():
        here = [row for row in timed if row["scene"] == scene]
        best = fastest_as_accurate(here, peer)
        name = f"{contestant.removeprefix('Siconos ')}; {method}"
        cells = [scene, name, peer["steps"], number(peer["error_max"]), number(peer["trace_error_max"]), seconds(peer["seconds"]["median"])]
        if best:
            ratio = peer["seconds"]["median"] / best["seconds"]["median"]
            ours = f"{best['contestant'].removeprefix('bromwich ')}, {best['steps']} steps, {best['threads']} thread{'s' if best['threads'] > 1 else ''}"
            cells += [ours, seconds(best["seconds"]["median"]), f"**{ratio_text(ratio)}**" if ratio < 1 else ratio_text(ratio)]
        else:
            cells += ["none as accurate", "-", "-"]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    worst = max(row["difference_from_euler"] or 0 for row in data["rows"])
    lost = [note.removeprefix("bromwich loses: ") for note in data["notes"] if note.startswith("bromwich loses: ")]
    lines += [
        "",
        "Of every variant the number of steps at which it does best against us. Of all rungs "
        + ("we lose (the ladder of our runs ends at " + str(max(row["steps"] for row in timed if row["contestant"] == "bromwich march")) + " steps):" if lost else "we lose none."),
        "",
    ]
    lines += ["- " + note for note in lost]
    return lines + [
        "",
        f"{data['details']['siconos']}. Its implicit Euler method and ours give the same y and N x on the same grids, to {number(worst)}; "
        f"theta = gamma = 0.5: {data['details']['theta'].removeprefix('theta = gamma = 1/2 ')}. {machine(data)}, fresh processes taking "
        f"turns, median of {data['repeats']} repeats (of {min(row['repeats'] for row in data['rows'] if row['contestant'].startswith('Siconos'))} "
        "at least where one run takes seconds).",
    ]


def least_ratios(data):
    """{(scene, variant, method): (the least ratio of Siconos to the fastest run of bromwich that is no less accurate, the error of y
    of Siconos there)}."""
    timed = [row for row in data["rows"] if row["status"] == "solved" and row["seconds"]]
    least = {}
    for row in timed:
        best = fastest_as_accurate([other for other in timed if other["scene"] == row["scene"]], row)
        if row["contestant"].startswith("Siconos") and best:
            place = (row["scene"], row["contestant"], row["method"])
            ratio = row["seconds"]["median"] / best["seconds"]["median"]
            found = (ratio, row["error_max"])
            least[place] = min(least.get(place, found), found)
    return least


def headline(data):
    """Siconos at its best on the finest Signorini scene, and its dense variants on the small circuits, for the README."""
    least = least_ratios(data)
    scene = [scene for scene, _, _ in least if scene.startswith("signorini")][-1]
    large, error = min(found for place, found in least.items() if place[0] == scene)
    small = [ratio for place, (ratio, _) in least.items() if not place[0].startswith("signorini") and "dense" in place[1]]
    return [
        f"- Siconos, where it does best against us and at errors no smaller, takes **{min(small):.1f} to {max(small):.1f} times** as long on small dense circuits "
        f"([their errors](docs/measurements/siconos.md)), and **{ratio_text(large)} times** on this scene with {scene.removeprefix('signorini, ')} "
        f"(error {number(error)}), whose A it takes as a general matrix ({origin(data)})."
    ]
