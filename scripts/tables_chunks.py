"""The tables of method shooting over chunks of time (scripts/bench_chunks)."""
from evidence import number, origin, plain


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


def times(data):
    """Seconds of march on one core beside those of shooting on the cores of the host and on its device."""
    heads = ["scene", "steps", "march on one core", "chunks on the host", "passes", "on the device", "passes", "with rows: march", "host", "device", "whole: march", "host", "device"]
    lines = ["| " + " | ".join(heads) + " |", "|--" * len(heads) + "|"]
    places = ("march", "host", "device")

    def milliseconds(seconds):
        return plain(seconds * 1e3)

    def by_pieces(row, name):  # others say how long their problems took, not their steps
        return "by affine pieces" in row[name]["kernel"]

    for row in data["scenes"]:
        alone, rows = ({name: row[name][key]["median"] for name in places} for key in ("resident", "seconds"))
        ratio = {
            name: f"{milliseconds(alone[name])} ({plain(alone['march'] / alone[name])})" if by_pieces(row, name) else "in turn" for name in places[1:]
        }
        whole = [milliseconds(row["whole"][name]) if "whole" in row else "-" for name in places]
        cells = [f"`{row['scene']}`", row["steps"], milliseconds(alone["march"]), ratio["host"], row["host"]["passes"], ratio["device"],
                 row["device"]["passes"], *(milliseconds(rows[name]) for name in places), *whole]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    apart = max(max(row[name]["apart"]) for row in data["scenes"] for name in places[1:])
    return lines + ["", f"Milliseconds, medians; in brackets how many times march takes. The first three times are those of the steps alone, with sources and rows "
                    f"where they are; then with all rows of x and y in the memory of the host; then of one whole call without a certificate, sources sampled "
                    f"in it. The host has {data['threads']} threads. x and y differ from those of march by at most {number(apart)} of their size. "
                    f"{data['device']}, {origin(data)}."]
