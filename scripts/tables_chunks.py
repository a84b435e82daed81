"""The tables of method shooting over chunks of time (scripts/bench_chunks)."""
from evidence import number, origin


def random(data):
    """How many random scenes took how many passes, and what differs from method march."""
    r = data["random"]
    passes = r["scenes_by_passes"]
    many = sum(count for number_of, count in passes.items() if int(number_of) > 8)
    few = {number_of: count for number_of, count in passes.items() if int(number_of) <= 8}
    lines = ["| passes | " + " | ".join(few) + " | more |", "|--" * (len(few) + 2) + "|"]
    lines.append("| solved random scenes | " + " | ".join(str(count) for count in few.values()) + f" | {many} |")
    return lines + [
        "",
        f"{r['scenes']} random scenes of all classes in {r['chunks']} chunks: {r['in_turn']} ended in turn. x and y differ from those of "
        f"`march` by at most {number(r['largest_difference'])} of their size, but in {r['differ'] + r['differ_as_by_rounding']} scenes; "
        f"in {r['differ_as_by_rounding']} of these march itself changes as much where the last digits of x0 do ({origin(data)}).",
    ]


def scenes(data):
    """Passes from a coarse march, from x0 in brackets; * where the rest was marched in turn."""
    chunks = sorted({row["chunks"] for row in data["rows"]})
    by_scene = {}
    for row in data["rows"]:
        by_scene.setdefault((row["name"], row["steps"]), {})[row["chunks"], row["start"]] = row
    heads = ["scene", "steps", *(f"{count} chunks" for count in chunks), "largest difference"]
    lines = ["| " + " | ".join(heads) + " |", "|--" * len(heads) + "|"]

    def cell(row):
        return f"{row['passes']}{'*' if row['in_turn'] else ''}"

    for (name, steps), rows in by_scene.items():
        cells = [f"{cell(rows[count, 'coarse'])} ({cell(rows[count, 'x0'])})" for count in chunks]
        apart = max(max(row["x"], row["y"]) for row in rows.values())
        scene = name.removeprefix("examples/").removesuffix(".toml")
        lines.append(f"| `{scene}` | {steps} | " + " | ".join(cells) + f" | {number(apart)} |")
    return lines + ["", f"Passes begun from a march with a tenth of the steps, and from x0 in all chunks; * the rest was marched in turn. "
                    f"The difference is that from `march`, of the size of x or y ({origin(data)})."]
