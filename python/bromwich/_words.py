"""Misspelt words, and words of other programs."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

# A, B, C, D and lambda are Siconos's; t_span and rtol are SciPy's.
OTHERS = {
    "abstol": "atol",
    "automatic": "auto",
    "C": "N",
    "D": "M",
    "dt": "steps",
    "end_time": "T",
    "eps": "tol",
    "final_time": "T",
    "h": "steps",
    "initial": "x0",
    "J": "steps",
    "mass": "E",
    "max_time": "T",
    "N_steps": "steps",
    "n_steps": "steps",
    "rtol": "tol",
    "t_end": "T",
    "t_final": "T",
    "t_max": "T",
    "t_span": "T",
    "tf": "T",
    "tfinal": "T",
    "timesteps": "steps",
    "tolerance": "tol",
    "verbose": "progress",
    "workers": "threads",
    "x_0": "x0",
    "y0": "x0",
}


def suggestion(word: str, candidates: Iterable[str]) -> str:
    """A similar word, in brackets, or an empty text."""
    known = list(candidates)
    other = OTHERS.get(word)
    lower = {candidate.lower(): candidate for candidate in known}
    near = [other] if other in known else [lower[word.lower()]] if word.lower() in lower else None
    near = near or difflib.get_close_matches(word, known, 1)
    return f" (did you mean {near[0]!r}?)" if near else ""
