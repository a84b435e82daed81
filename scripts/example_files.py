"""What scripts/make_examples writes with: TOML lists, Matrix Market files, wrapped comments. `made` holds the text of
every file by its name.
"""
import re
import textwrap

import numpy as np

made = {}


def numbers(values, digits=13):
    """A TOML list, wrapped."""
    words = [f"{v:.{digits}g}" for v in np.asarray(values, dtype=float)]
    lines, line = [], ""
    for word in words:
        if len(line) + len(word) > 112:
            lines.append(line.rstrip())
            line = ""
        line += word + ", "
    lines.append(line.rstrip(", "))
    return "[" + lines[0] + "]" if len(lines) == 1 else "[\n  " + "\n  ".join(lines) + ",\n]"


def texts(words):
    return "[\n" + "".join(f'  "{word}",\n' for word in words) + "]"


def rows(matrix):
    return "[" + ", ".join("[" + ", ".join(f"{v:.17g}" for v in row) + "]" for row in np.asarray(matrix)) + "]"


def matrix_market(name, matrix):
    """Coordinate format; the entries are exact."""
    entries = [(i + 1, j + 1, matrix[i, j]) for j in range(matrix.shape[1]) for i in np.flatnonzero(matrix[:, j])]
    lines = ["%%MatrixMarket matrix coordinate real general", "% written by scripts/make_examples"]
    lines += [f"{matrix.shape[0]} {matrix.shape[1]} {len(entries)}"] + [f"{i} {j} {float(v)!r}" for i, j, v in entries]
    made[name] = "\n".join(lines) + "\n"


def wrapped(text):
    """Comment lines of a scene file wrapped at 118 columns; some words begin a paragraph."""
    lines = []
    for line in text.split("\n"):
        joins = lines and re.match("# [^ ]", lines[-1]) and re.match("# [^ ]", line)
        if joins and not re.match(r"# (x =|Difficulty|Prescribed)", line):
            lines[-1] += line[1:]
        else:
            lines.append(line)
    out = []
    for line in lines:
        comment = line.startswith("# ")
        out += textwrap.wrap(line, 118, subsequent_indent="# ", break_long_words=False) if comment else [line]
    return "\n".join(out)
