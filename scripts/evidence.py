"""What the scripts of tables and pictures share: the committed measurements, words for them, and the mark in every
picture that says which measurements it was drawn from."""
import hashlib
import json
import os
import pathlib
import re
import subprocess
import tempfile

root = pathlib.Path(__file__).resolve().parent.parent
results = root / "bench" / "results"
pictures = root / "docs" / "pictures"


def facts(command):
    """Machine, compiler and commit of a build, as its studies write them."""
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "study.json"
        subprocess.run([command, "bench", "auto", "--quick", "--out", file], capture_output=True, check=True)
        study = json.loads(file.read_text())
    return {key: study[key] for key in ("machine", "compiler", "build_type", "flags", "commit", "version")}


def commit():
    """The 40 digits of the commit that is measured: of BROMWICH_COMMIT, else of this checkout."""
    given = os.environ.get("BROMWICH_COMMIT")
    return given or subprocess.run(["git", "-C", root, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()


# The mark of a picture that shows the program and no measurement.
screenshot_mark = "a screenshot of bromwich"


def load(name):
    return json.loads((results / f"{name}.json").read_text())


def sweeps_of_table():
    """The sweeps of the columns of Table 4.1 on a device; none where they are not measured."""
    path = results / "paper-gpu.json"
    return [row for row in json.loads(path.read_text())["rows"] if row["part"] == "sweep"] if path.exists() else []


def seconds(value):
    """12.3 ms, with the unit that keeps three digits."""
    for unit, factor in (("s", 1), ("ms", 1e3), ("µs", 1e6)):
        if value * factor >= 1:
            digits = f"{value * factor:.3g}"
            return f"{float(digits):.0f} {unit}" if "e" in digits else f"{digits} {unit}"
    return f"{value * 1e9:.3g} ns"


def number(value):
    return "" if value is None else f"{value:.1e}"


def machine(data):
    return f"{data['machine']['cpu']}, {data['threads']} threads, {data['compiler']}, commit {data['commit'][:9]}"


def repeats(data):
    return f"{machine(data)}, median of {data['repeats']} interleaved repeats"


def origin(data):
    return f"commit {data['commit'][:9]}"


def plain(ratio):
    """Three digits without an exponent."""
    return f"{ratio:.3g}" if ratio < 1000 else f"{float(f'{ratio:.3g}'):.0f}"


def sources_mark(names):
    """'NAME:HASH ...' of the measurements as they are committed."""
    marks = []
    for name in names:
        digest = hashlib.sha256((results / f"{name}.json").read_bytes()).hexdigest()
        marks.append(f"{name}:{digest[:16]}")
    return "measurements " + " ".join(marks)


def page_mark(page):
    """'page PAGE:HASH' of the Python on a page of docs/ that draws a picture."""
    blocks = re.findall(r"^```python\n(.*?)^```", (root / page).read_text(encoding="utf-8"), re.M | re.S)
    return f"page {page}:{hashlib.sha256(''.join(blocks).encode()).hexdigest()[:16]}"


def file_mark(name):
    """'file NAME:HASH' of a program that draws a picture."""
    return f"file {name}:{hashlib.sha256((root / name).read_bytes()).hexdigest()[:16]}"


def save(figure, picture, names):
    """Writes docs/pictures/PICTURE (.svg or .png), marked with the measurements NAMES that it shows."""
    pictures.mkdir(exist_ok=True)
    mark = sources_mark(names)
    path = pictures / picture
    if path.suffix == ".svg":
        figure.savefig(path, metadata={"Source": mark, "Date": None, "Creator": None})
    else:
        figure.savefig(path, metadata={"Source": mark, "Software": None})
    return path


def outdated_pictures():
    """Pictures that README or docs show and that are missing, or whose mark is not that of the committed measurements, or
    of the page whose code draws them."""
    texts = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    shown = {name for text in texts for name in re.findall(r"\]\((?:docs/|\.\./)?pictures/([^)]+)\)", text.read_text())}
    wrong = []
    for path in sorted({pictures / name for name in shown} | set(pictures.glob("*.*"))):
        if not path.exists():
            wrong.append(path.name)
            continue
        if screenshot_mark.encode() in path.read_bytes():
            continue
        drawn = re.search(rb"page (docs/[\w/-]+\.md):[0-9a-f]{16}", path.read_bytes())
        if drawn and (root / drawn[1].decode()).exists():
            if page_mark(drawn[1].decode()) != drawn[0].decode():
                wrong.append(path.name)
            continue
        drawn = re.search(rb"file (examples/\w+\.py):[0-9a-f]{16}", path.read_bytes())
        if drawn and (root / drawn[1].decode()).exists():
            if file_mark(drawn[1].decode()) != drawn[0].decode():
                wrong.append(path.name)
            continue
        found = re.search(rb"measurements((?: \w[\w-]*:[0-9a-f]{16})+)", path.read_bytes())
        names = [word.split(":")[0] for word in found[1].decode().split()] if found else []
        if not found or not all((results / f"{name}.json").exists() for name in names):
            wrong.append(path.name)
        elif sources_mark(names) != found[0].decode():
            wrong.append(path.name)
    return wrong
