"""Method march of bromwich on the arrays of a field, in a process of its own, as the other contestants are.

field_march.py PROBLEM.npz RESULT.npz THREADS

PROBLEM.npz: see write_arrays of field_contestants.py. Writes y and w, and prints the facts of a row.
"""
import json
import math
import sys

import bromwich
import numpy as np
import scipy.sparse as sp
from memory import peak_bytes


def main(problem, result, threads):
    f = np.load(problem)
    m, n = int(f["m"]), len(f["contacts"])
    A = sp.csr_array((f["data"], f["indices"], f["starts"]), shape=(m, m)).tocsc()
    unit = sp.csc_array((np.ones(n), (f["contacts"], np.arange(n))), shape=(m, n))
    g = f["g"]
    found = bromwich.solve(
        A=A, B=float(f["b"]) * unit, N=unit.T.tocsr(), M=float(f["compliance"]) * sp.eye_array(n, format="csr"), g=g,
        x0=np.zeros(m), T=float(f["T"]), steps=len(g) - 1, method="march", threads=int(threads),
    )  # fmt: skip
    np.savez(result, y=found.y, w=found.w)
    facts = {
        "status": str(found.status),
        "kernel": found.kernel,
        "kernel_error": found.kernel_error if math.isfinite(found.kernel_error) else None,
        "bytes": int(found.bytes),
        "peak_bytes": peak_bytes(),
        "seconds": {"total": found.timings["total"], "setup": found.timings["setup"]},
    }
    print(json.dumps(facts))


if __name__ == "__main__":
    main(*sys.argv[1:4])
