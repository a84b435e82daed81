"""nanobind.stubgen for a module that needs an OpenMP runtime in the process."""

import importlib.util
import pathlib
import sys

from nanobind.stubgen import main

spec = importlib.util.spec_from_file_location("_load", pathlib.Path(__file__).parent / "bromwich" / "_load.py")
loading = importlib.util.module_from_spec(spec)
spec.loader.exec_module(loading)
loading.openmp()
main(sys.argv[1:])
