"""The Python of README.md, docs/python.md and docs/output.md runs as it stands there."""

import re
from pathlib import Path

import pytest

import bromwich

ROOT = Path(__file__).parents[2]


def test_the_reference_has_every_name():
    page = (ROOT / "docs" / "python-reference.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\.\. auto\w+:: (\w+)$", page, re.M)
    assert sorted(listed) == sorted(set(bromwich.__all__) - {"__version__"})


@pytest.mark.parametrize("name", ["README.md", "docs/python.md", "docs/output.md"])
def test_code_runs(name, monkeypatch, tmp_path):
    pytest.importorskip("scipy")
    pytest.importorskip("h5netcdf")
    pytest.importorskip("xarray")
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / name).read_text(encoding="utf-8"), re.M | re.S)
    assert blocks
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "document"}
    for block in blocks:
        exec(compile(block, name, "exec"), names)
