import signal

import bromwich
import numpy as np
import pytest


@pytest.fixture
def ctrl_c():
    """Ctrl-C raises, also where the tests were started in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def diode():
    """x' = -x + y + f, 0 <= y complementary to x + y - g >= 0, by name."""
    return dict(A=[[-1.0]], B=[[1.0]], N=[[1.0]], M=[[1.0]], x0=[0.0], T=2.0)


@pytest.fixture
def heat():
    """Heat on a line of 300 cells, as SciPy has it: kept at 0 on the right, contact with an obstacle on the left."""
    sparse = pytest.importorskip("scipy.sparse")
    m, dx = 300, 1 / 300
    A = sparse.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(m, m), format="csr") / dx**2
    A = A.tolil()
    A[0, 0] = -1 / dx**2
    B = sparse.coo_array(([1 / dx], ([0], [0])), shape=(m, 1))
    N = sparse.coo_array(([1.0], ([0], [0])), shape=(1, m))
    g = lambda t: -0.2 * np.sin(3 * t)
    return dict(A=A.tocsr(), B=B, N=N, M=[[0.1]], g=g, x0=np.zeros(m), T=1.0)


def is_view(array):
    return not array.flags.owndata and not array.flags.writeable


@pytest.fixture
def Q15():
    return bromwich.scene("signorini", Q=15)
