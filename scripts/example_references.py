"""Reference solutions of the scenes that scripts/make_examples writes, by other methods than the solver's: switches are
located by bisection; between them the linear system is advanced by its eigenvectors, or by Runge-Kutta steps where
those are badly conditioned. Needs numpy.
"""
import numpy as np

INFINITY = float("inf")

def bisect(g, a, b):
    """The zero of g between a and b, g(a) > 0 > g(b), to rounding."""
    for _ in range(100):
        c = 0.5 * (a + b)
        a, b = (c, b) if g(c) > 0 else (a, c)
    return b


def symmetric_flow(A, scale, c0, c1, x, t0):
    """x' = A x + c0 + c1 t with diag(scale) A diag(1/scale) symmetric: the solution as a function of time."""
    lam, V = np.linalg.eigh(scale[:, None] * A / scale)

    def solve(b):
        return V @ ((V.T @ b) / lam)

    q = -solve(scale * c1)
    p = solve(q - scale * c0)
    z = V.T @ (scale * x - p - q * t0)
    return lambda t: (V @ (np.exp(lam * (t - t0)) * z) + p + q * t) / scale


def second_difference(n, dx):
    return (np.diag(np.full(n, -2.0)) + np.diag(np.ones(n - 1), 1) + np.diag(np.ones(n - 1), -1)) / dx**2


def runge_kutta(rhs, guard, x, start, end, h):
    """Runge-Kutta 4; a step in which a component of guard(x) changes its sign ends there and a fresh one begins."""

    def step(t, x, h):
        k1 = rhs(t, x)
        k2 = rhs(t + h / 2, x + h / 2 * k1)
        k3 = rhs(t + h / 2, x + h / 2 * k2)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rhs(t + h, x + h * k3))

    t = start
    while end - t > 1e-12 * (end - start):
        length = min(h, end - t)
        y, sides = step(t, x, length), guard(x) > 0
        if ((guard(y) > 0) != sides).any():
            length = bisect(lambda s: 0.5 - float(((guard(step(t, x, s)) > 0) != sides).any()), 0.0, length)
            y = step(t, x, length)
        t, x = t + length, y
    return x


def stefan_solution(n, T):
    """w_i and y_i at T, i = 1..n-1: k cells are wet, w' = D w - 1 + e_1 t/dx^2; the next begins when y = 0."""
    dx, t, k, w = 1 / n, 1 / n**2, 1, np.zeros(1)
    while True:
        e1 = np.eye(1, k)[0]
        flow = symmetric_flow(second_difference(k, dx), np.ones(k), -np.ones(k), e1 / dx**2, w, t)
        b = t + dx**2
        while flow(b)[-1] < dx**2 and b < T:
            b = t + 2 * (b - t)
        if flow(min(b, T))[-1] < dx**2:
            break
        t, k, w = (s := bisect(lambda s: dx**2 - flow(s)[-1], t, b)), k + 1, np.append(flow(s), 0)
        if t > T:
            raise RuntimeError("the last event was passed")
    w = np.append(flow(T), np.zeros(n - 1 - k))
    y = np.where(np.arange(n - 1) < k, 0.0, 1.0)
    y[k] = 1 - w[k - 1] / dx**2
    return w, y


def put_solution(phi, left, lower, diagonal, upper, T):
    """V and y at T: nodes from k on are free, k falls by one when the multiplier of node k-1 reaches zero."""
    n, t, V = len(phi), 0.0, phi.copy()
    k = int(np.argmax(phi <= 0))
    while True:
        m = n - k
        A = np.diag(np.full(m, diagonal)) + np.diag(np.full(m - 1, upper), 1) + np.diag(np.full(m - 1, lower), -1)
        c = np.eye(1, m)[0] * lower * phi[k - 1]
        flow = symmetric_flow(A, np.sqrt(upper / lower) ** np.arange(m), c, np.zeros(m), V[k:], t)

        def multiplier(s):
            return -(lower * phi[k - 2] + diagonal * phi[k - 1] + upper * flow(s)[0])

        if multiplier(T) > 0:
            break
        t = t if multiplier(t) < 0 else bisect(multiplier, t, T)
        V[k:] = flow(t)
        k -= 1
    V[k:] = flow(T)
    y = -(diagonal * V + lower * np.append(left, V[:-1]) + upper * np.append(V[1:], 0))
    return V, np.where(np.arange(n) < k, y, 0.0)


def bar_modes(mass, stiffness):
    """omega and vectors of mass q'' = -stiffness q in q sqrt(mass)."""
    scale = 1 / np.sqrt(mass)
    squares, vectors = np.linalg.eigh(scale[:, None] * stiffness * scale)
    return np.sqrt(np.where(squares > 1e-8, squares, 0)), vectors


def bar_solution(mass, stiffness, eps, gap, T):
    """q at T and the number of times that the first node meets the wall or leaves it."""
    touching = stiffness.copy()
    touching[0, 0] += 1 / eps
    modes = [bar_modes(mass, stiffness), bar_modes(mass, touching)]
    scale = np.sqrt(mass)
    q, v, t, contact, events = gap * scale, -scale, 0.0, 0, 0
    while True:
        omega, Q = modes[contact]
        a, b = Q.T @ q, Q.T @ v
        still = omega == 0
        b_over = np.where(still, 0, b / np.where(still, 1, omega))

        def gap_at(s):
            phase = np.multiply.outer(np.atleast_1d(s), omega)
            position = np.cos(phase) @ (a * Q[0]) + np.sin(phase) @ (b_over * Q[0]) + s * (b[still] @ Q[0, still])
            return -position if contact else position

        step = 2e-6 if contact else 2e-5
        begin, found = 1e-3 * step, None
        while found is None and t + begin < T:
            s = begin + step * np.arange(2001)
            outside = np.flatnonzero(gap_at(s) < 0)
            if len(outside):
                found = bisect(lambda z: gap_at(z)[0], s[max(outside[0] - 1, 0)], s[outside[0]])
            begin = s[-1]
        s = min(found if found is not None else np.inf, T - t)
        c, d = np.cos(omega * s), np.sin(omega * s)
        q, v = Q @ (a * c + b_over * d + np.where(still, b * s, 0)), Q @ (b * c - a * omega * d)
        if found is None or t + found >= T:
            return q / scale, v / scale, events
        q[0], t, contact, events = 0.0, t + s, 1 - contact, events + 1


def affine_flow(A, c, x, length):
    """The solution of x' = A x + c after `length`, by the Taylor series of the exponential on 2^-k of it, squared."""
    n = len(c)
    H = np.zeros((n + 1, n + 1))
    H[:n, :n], H[:n, n] = A * length, c * length
    k = max(0, int(np.ceil(np.log2(max(np.abs(H).sum(axis=1).max(), 1e-300)))) + 4)
    term = total = np.eye(n + 1)
    for j in range(1, 20):
        term = term @ H / 2**k / j
        total = total + term
    for _ in range(k):
        total = total @ total
    return total[:n, :n] @ x + total[:n, n]


def converter_solution(on, off, duty, period, periods, shift, x, conducts):
    """A converter in continuous conduction after `periods`: (A, c) with the switch on and off; it is on from `shift` of
    every period on. `conducts(x)`, the current of the diode in the off state, must stay positive there; it is looked at in
    50 points of every off interval."""

    def while_off(x, length):
        for _ in range(50):
            x = affine_flow(*off, x, length / 50)
            assert conducts(x) > 0, "the converter leaves continuous conduction"
        return x

    x = while_off(x, shift)
    for k in range(periods):
        x = affine_flow(*on, x, duty * period)
        x = while_off(x, (1 - duty) * period - (shift if k + 1 == periods else 0))
    return x


def discontinuous_converter_solution(on, off, idle, duty, period, periods, shift, x, current):
    """The same in discontinuous conduction: within every off interval the diode conducts until `current(x)` falls to 0,
    located by bisection, and the converter idles until the switch closes."""

    def while_off(x, length):
        if current(x) <= 0:
            return affine_flow(*idle, x, length)
        end = bisect(lambda s: current(affine_flow(*off, x, s)), 0.0, length)
        x = affine_flow(*off, x, end)
        assert end < length, "the converter leaves discontinuous conduction"
        return affine_flow(*idle, x, length - end)

    x = affine_flow(*idle, x, shift)
    for k in range(periods):
        x = affine_flow(*on, x, duty * period)
        x = while_off(x, (1 - duty) * period - (shift if k + 1 == periods else 0))
    return x


class BridgeOfThreePhases:
    """A bridge of six diodes between three line inductances L and a capacitor C with load R: x = (i_a, i_b, i_c, v).
    `sides`: 1 where a phase is on the positive rail, -1 on the negative one, 0 where its diodes block."""

    def __init__(self, amplitude, omega, L, C, R):
        self.amplitude, self.omega, self.L, self.C, self.R = amplitude, omega, L, C, R
        self.sides = np.zeros(3)

    def emf(self, t):
        return self.amplitude * np.sin(self.omega * t - 2 * np.pi / 3 * np.arange(3))

    def potentials(self, t, v):
        """Of the three line ends, above the negative rail; of blocking phases those without a current."""
        on = self.sides != 0
        e, rail = self.emf(t), np.where(self.sides > 0, v, 0.0)
        star = np.mean((rail - e)[on]) if on.any() else -e.min()
        return np.where(on, rail, e + star), star

    def rhs(self, t, x):
        u, star = self.potentials(t, x[3])
        current = np.where(self.sides != 0, (self.emf(t) + star - u) / self.L, 0.0)
        return np.r_[current, (np.maximum(x[:3], 0).sum() - x[3] / self.R) / self.C]

    def margins(self, t, x):
        """Positive while the sides stay: currents of conducting phases, reverse voltages of blocking ones."""
        u, _ = self.potentials(t, x[3])
        if not self.sides.any():
            return np.full(3, x[3] - (u.max() - u.min()))
        return np.where(self.sides != 0, self.sides * x[:3], np.minimum(u, x[3] - u))

    def switch(self, t, x, k):
        u, _ = self.potentials(t, x[3])
        if not self.sides.any():
            self.sides[np.argmax(u)], self.sides[np.argmin(u)] = 1, -1
        elif self.sides[k] != 0:
            x[k] = 0.0
            self.sides[k] = 0
            if np.count_nonzero(self.sides) == 1:
                self.sides[:] = 0
                x[:3] = 0.0
        else:
            self.sides[k] = 1 if x[3] - u[k] < u[k] else -1

    def solve(self, x, end, h):
        """Runge-Kutta 4 with steps h; a step after which a margin is negative ends where that margin is zero."""

        def step(t, x, h):
            k1 = self.rhs(t, x)
            k2 = self.rhs(t + h / 2, x + h / 2 * k1)
            k3 = self.rhs(t + h / 2, x + h / 2 * k2)
            return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + self.rhs(t + h, x + h * k3))

        t, switches = 0.0, 0
        while end - t > 1e-12 * end:
            length = min(h, end - t)
            y = step(t, x, length)
            k = int(np.argmin(self.margins(t + length, y)))
            if self.margins(t + length, y)[k] < 0:
                first, length = length, INFINITY
                for i in range(3):  # the margin that is zero first
                    at = lambda s, i=i: self.margins(t + s, step(t, x, s))[i]
                    if at(first) < 0 and (zero := bisect(at, 0.0, first)) < length:
                        length, k = zero, i
                y = step(t, x, length)
                self.switch(t + length, y, k)
                switches += 1
            t, x = t + length, y
        return x, switches
