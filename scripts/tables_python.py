"""The table of docs/python.md: what Python adds to a solve."""

from evidence import machine, seconds


def python(data):
    lines = ["| scene | steps | C++ | C++, pages kept | Python | Python less C++ | quartiles |", "|--" * 7 + "|"]
    for row in data["rows"]:
        Q = row["parameters"].get("Q")
        name = row["scene"] + (f", Q = {Q:g}" if Q else "")
        over = row["overhead"]
        low, high = (f"{1e6 * q:.0f} us" for q in over["quartiles"])
        lines.append(
            f"| {name} | {row['steps']} | {seconds(row['cpp']['median'])} | {seconds(row['cpp_keep_pages']['median'])} | "
            f"{seconds(row['python']['median'])} | {1e6 * over['median']:.0f} us ({100 * over['median'] / row['cpp']['median']:.1f} %) | "
            f"{low}, {high} |"
        )
    return lines + [
        "",
        f"Medians of {data['repeats']} rounds, C++ and Python in turns of random order, of each the least of a block of solves. {machine(data)}.",
    ]
