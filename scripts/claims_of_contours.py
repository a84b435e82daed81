"""Claims of Wu and Chen about contours, for scripts/paper_claims: (2.3), and Remark 2.4 with the error (1.7)."""
import itertools
import math

import numpy as np
from scipy.optimize import minimize


def contour_2_3():
    """(2.3): a hyperbola for the stable eigenvalues and a circle about each of the others, against the exponential."""
    rng = np.random.default_rng(1)
    rows = []
    for name, others in (("zero", [0]), ("imaginary", [2j, -2j]), ("unstable", [1.5]), ("all", [0, 2j, -2j, 1.5])):
        D = np.diag(np.array([-4, -6, -30] + others, complex))
        V = rng.standard_normal(D.shape) + np.eye(len(D)) * 2
        R = np.linalg.inv(V)
        a, t = V @ D @ R, 1.0
        truth = V @ np.diag(np.exp(np.diag(D) * t)) @ R
        for P in (8, 16, 32, 64):
            # A hyperbola with its vertex at -1.5, between the stable eigenvalues and the circles.
            mu, g = 3.0, 0.6
            step = 2.2 / math.sqrt(P)
            v = np.arange(-P, P + 1) * step
            node = -1.5 - mu * (1 - math.sin(g)) + mu * (1 + np.sin(1j * v - g))
            weight = step / (2j * math.pi) * 1j * mu * np.cos(1j * v - g)
            total = sum(w * np.exp(z * t) * np.linalg.inv(z * np.eye(len(a)) - a) for w, z in zip(weight, node))
            count = 2 * P
            for z0 in others:
                turn = np.exp(2j * math.pi * np.arange(count) / count) * 0.5
                total = total + sum(r / count * np.exp((z0 + r) * t) * np.linalg.inv((z0 + r) * np.eye(len(a)) - a) for r in turn)
            error = float(np.abs(total - truth).max() / np.abs(truth).max())
            rows.append({"others": name, "P": P, "nodes_of_circle": count, "error": error})
    return rows


def literal_nodes(P):
    """z_p t, p = 0..P, of the printed contour (2.2)."""
    v = np.arange(P + 1) * 2.0603 / math.sqrt(P)
    return math.sqrt(P) / 4 * (1 + np.sin(1j * v - 0.794))


def literal_error(P, parameters, angle, fine=False):
    """(1.7) for the integral of e^{lambda s} over [0, 1], over spectra in the sector of half-angle `angle`."""
    mu, g, step = parameters
    p = np.arange(-P, P + 1) * step
    node, rate = mu * (1 + np.sin(1j * p - g)), 1j * mu * np.cos(1j * p - g)
    radius = np.logspace(-2, 6, 161 if fine else 41)
    lam = np.concatenate([-radius * np.exp(1j * angle), -radius])
    table = rate / node * np.expm1(node) / (node - lam[:, None])
    return float(np.abs(step / (2j * math.pi) * table.sum(1) - np.expm1(lam) / lam).max())


def retuned():
    """Remark 2.4: contours tuned for the angle of the spectrum, in place of those for a real one."""
    rows, real = [], {}
    for degrees in (0, 19.5, 44.5, 70):
        angle = math.radians(degrees)
        for P in (9, 16, 25, 49, 100):
            g = 0.794
            printed = (4.4 * P / 8, g, 2.06 / math.sqrt(P) / 1.0)
            best = None
            for scale, first in itertools.product((0.3, 1, 3), (0.2, 0.5, 0.794, 1.0)):
                if first >= math.pi / 2 - angle:
                    continue
                found = minimize(lambda q: math.log(literal_error(P, (math.exp(q[0]), q[1], math.exp(q[2])), angle) + 1e-16)
                                 + (1e3 * max(0, q[1] - (math.pi / 2 - angle)) + 1e3 * max(0, 0.02 - q[1])),
                                 [math.log(scale * math.sqrt(P)), first, math.log(3 / math.sqrt(P))], method="Nelder-Mead",
                                 options={"maxiter": 200, "xatol": 1e-3, "fatol": 1e-3})
                if best is None or found.fun < best.fun:
                    best = found
            q = best.x
            own = (math.exp(q[0]), float(q[1]), math.exp(q[2]))
            if degrees == 0:
                real[P] = own
            rows.append({"degrees": degrees, "P": P, "error": literal_error(P, own, angle, True),
                         "error_with_contour_for_real_spectra": literal_error(P, real[P], angle, True),
                         "printed_rate": math.exp(-2.06 * math.sqrt(P)) / math.sqrt(P),
                         "mu": own[0], "gamma": own[1], "step": own[2]})
    return rows
