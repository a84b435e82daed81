"""Scenes with prescribed solutions, for any A, B, N and M; see manufactured()."""
import numpy as np

from example_files import made, matrix_market, numbers, rows, texts, wrapped


def manufactured(name, description, comment, A, B, N, M, matrices=False):
    """x_i = cos((1 + i/m) t), y = S+, w = S-, S_j = sin(2 pi t + 0.3 + j): f = F (x', x, y), g = w - N x - M y. Both are of
    size 1, hence the tolerance."""
    m, n = B.shape
    rate = 1 + np.arange(m) / m
    x = [f"cos({float(r)!r}*t)" for r in rate]
    S = [f"sin(2*pi*t + {0.3 + j:g})" for j in range(n)]
    y = [f"max({s}, 0)" for s in S]
    F = np.hstack([np.diag(-rate), -A, -B])
    phi = [f"sin({float(r)!r}*t)" for r in rate] + x + y

    def combine(i):
        terms = [(-N[i, j], x[j]) for j in range(m)] + [(-M[i, j], y[j]) for j in range(n)]
        words = [f" {'-' if c < 0 else '+'} {abs(float(c))!r}*{term}" for c, term in terms if c]
        return f"max(-{S[i]}, 0)" + "".join(words)

    if matrices:
        for letter, matrix in (("A", A), ("B", B), ("N", N), ("F", F)):
            matrix_market(f"{name}-{letter}.mtx", matrix)

    def matrix(letter, value):
        return f'"{name}-{letter}.mtx"' if matrices else rows(value)

    made[name + ".toml"] = wrapped(f"""{comment}
#
# Prescribed: x_i = cos((1 + i/m) t), y_j = S_j+, w_j = S_j- with S_j = sin(2 pi t + 0.3 + j); f and g follow from
# them.
name = "{name}"
description = "{description}"

[dynamics]
A = {matrix("A", A)}
B = {matrix("B", B)}
F = {matrix("F", F)}
f = {texts(phi)}
x0 = {numbers(np.ones(m))}

[complementarity]
N = {matrix("N", N)}
M = {rows(M)}
g = {texts(combine(i) for i in range(n))}

[time]
T = 2
tol = 1e-4

[output]
states = "all"

[exact]
x = {texts(x)}
y = {texts(y)}

[reference]
tolerance = 1e-4
source = "the exact solution, prescribed; f = F (sin, x, y) = x' - A x - B y and g = w - N x - M y follow from it"
""")


COUPLED = np.array([[2.0, -1], [-1, 2]])
NONE = np.zeros((2, 2))

STIFF = """\
# A stiff system: eigenvalues -1e8, -1e4, -1e2, -1, -1e-4 and 0, eigenvectors from a reflection; constructed.
# Difficulty: """

NON_NORMAL = """\
# A single eigenvalue -1 of multiplicity 32 with one eigenvector: A = -I - 8 on the superdiagonal,
# ||e^A|| = 1046. Constructed.
# Difficulty: the eigenvalues do not describe this A; implicit Euler has an error of 29 with 1024 steps."""

UNSTABLE = """\
# A fast unstable spiral with eigenvalues 5 +- 20i and a slow oscillator with +-3i; constructed.
# Difficulty: errors grow by up to e^10; implicit Euler has an error of 0.63 with 1024 steps."""

DAMPED = """\
# A damped system (eigenvalues -0.75 +- i and -1 +- 0.15 i) in which y acts directly on N x; constructed.
# Difficulty: """


def stiff():
    v = np.arange(1.0, 7)
    V = np.eye(6) - 2 * np.outer(v, v) / (v @ v)
    A = V @ np.diag([-1e8, -1e4, -1e2, -1, -1e-4, 0]) @ V.T
    B = np.cos(np.arange(6)[:, None] + 2 * np.arange(2))
    about = STIFF + "no step resolves the fast modes, and an eigenvalue is zero."
    known = "eigenvalues -1e8 to 0; the exact solution is known"
    manufactured("stiff", f"stiff system, {known}", about, A, B, B.T, COUPLED)
    about = STIFF + "M = 0, y is determined only through x', which is stiff."
    known = f"stiff system with M = 0, {known}"
    manufactured("stiff-singular", known, about, A, B, B.T, NONE)


def non_normal():
    m = 32
    A = -np.eye(m) - 8 * np.eye(m, k=1)
    B = np.eye(m)[:, [m - 1, 0]]
    known = "all eigenvalues -1, yet e^{At} grows to 1000; the exact solution is known"
    manufactured("non-normal", known, NON_NORMAL, A, B, B.T, COUPLED, matrices=True)


def unstable():
    A = np.zeros((4, 4))
    A[:2, :2] = [[5, 20], [-20, 5]]
    A[2:, 2:] = [[0, 3], [-3, 0]]
    B = np.eye(4)[:, [0, 2]]
    known = "open loop grows like e^{5t}; the exact solution is known"
    manufactured("unstable", known, UNSTABLE, A, B, B.T, COUPLED)
    A = A / 20 - np.eye(4)
    about = DAMPED + "M = 1e-10 I is a P-matrix but numerically singular; continuous piecewise-linear y would ring from step to step."
    known = "M = 1e-10 I; the exact solution is known"
    manufactured("nearly-singular", known, about, A, B, B.T, 1e-10 * np.eye(2))
    about = DAMPED + "M = 0; at t = 0 complementarity alone does not determine y."
    manufactured("singular", "M = 0; the exact solution is known", about, A, B, B.T, NONE)
