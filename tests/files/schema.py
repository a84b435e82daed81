#!/usr/bin/env python3
"""schema.py SCHEMA EXAMPLES: every scene file of a folder is valid by the JSON Schema, and mistakes are not.

Exit code 77, a skipped test, where Python has no jsonschema or no tomllib.
"""

import copy
import json
import sys
from pathlib import Path

try:
    import jsonschema
    import tomllib
except ImportError as missing:
    print(f"schema.py: {missing}; scripts/python-env installs jsonschema")
    sys.exit(77)

# Changes of a valid scene: each must be refused.
MISTAKES = {
    "an unknown section": lambda s: s.update(dynamic={}),
    "an unknown key": lambda s: s["dynamics"].update(a=1),
    "A is a number": lambda s: s["dynamics"].update(A=1),
    "A is one list": lambda s: s["dynamics"].update(A=[1, 2]),
    "an unknown class": lambda s: s["complementarity"].update({"class": "Q"}),
    "T is a list": lambda s: s["time"].update(T=[1]),
    "two spacings of three": lambda s: s.update(kronecker=dict(points=3, spacing=[1, 1, 1], diffusivity=1, b=[1], n=[1])),
    "a name is a number": lambda s: s.update(names={"x": [1, 2]}),
    "a swept parameter is a number": lambda s: s.update(sweep={"R": 1}),
    "include is a number": lambda s: s.update(include=1),
}


def main() -> int:
    schema = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    jsonschema.Draft7Validator.check_schema(schema)
    validator = jsonschema.Draft7Validator(schema)
    files = sorted([*Path(sys.argv[2]).glob("*.toml"), *Path(sys.argv[2]).glob("nonlinear/*.toml")])
    scenes = {file.name: tomllib.loads(file.read_text(encoding="utf-8")) for file in files}
    failed = 0
    for name, scene in scenes.items():
        for error in validator.iter_errors(scene):
            print(f"{name}: {error.json_path}: {error.message}")
            failed += 1
    for mistake, change in MISTAKES.items():
        scene = copy.deepcopy(scenes["template.toml"])
        change(scene)
        if validator.is_valid(scene):
            print(f"the schema accepts a scene in which there is {mistake}")
            failed += 1
    print(f"{len(scenes)} scene files, {len(MISTAKES)} mistakes, {failed} failures")
    return 1 if failed or not scenes else 0


sys.exit(main())
