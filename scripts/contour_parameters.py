#!/usr/bin/env python3
"""Finds the contour parameters stored in core/numerics/contour.cpp.

For a sector |arg(-a)| <= half-angle and P + 1 nodes it minimises, over (gamma, dv, mu), the worst error of
  window: e^{at} over t in [1, 5], and
  near:   phi2(a), phi1(a)^2 and (phi1 - phi2)(a), the weights of lags 0, 1 and of y_0 at lag 1,
in double precision, by Nelder-Mead from a grid of starts. Needs numpy, scipy, mpmath.

    scripts/contour_parameters.py 0 24        # degrees, P
"""
import argparse

import mpmath
import numpy as np
from scipy.optimize import minimize

mpmath.mp.dps = 40


def sector(half_angle):
    radii = np.geomspace(1e-3, 1e5, 90)
    rays = [radii * np.exp(1j * (np.pi - half_angle * f)) for f in (0, 0.25, 0.5, 0.75, 1)]
    return np.concatenate([[0]] + rays)


def contour(parameters, P):
    gamma, dv, mu = parameters
    v = np.arange(-P, P + 1) * dv
    z = mu * (1 + np.sin(1j * v - gamma))
    return z, dv / (2j * np.pi) * mu * 1j * np.cos(1j * v - gamma)


def phi(a):
    if a == 0:
        return 1.0, 0.5
    a = mpmath.mpc(a)
    e = mpmath.exp(a)
    return complex((e - 1) / a), complex((e - 1 - a) / a**2)


def targets(kind, a):
    """Functions of z to integrate against 1/(z - a), and what they should give."""
    if kind == "window":
        times = np.geomspace(1, 5, 31)
        return [(lambda z, t=t: np.exp(t * z), np.exp(t * a)) for t in times]
    values = np.array([phi(x) for x in a])
    phi1, phi2 = values[:, 0], values[:, 1]
    return [
        (lambda z: np.exp(z) / z**2, phi2),
        (lambda z: (np.exp(2 * z) - 2 * np.exp(z)) / z**2, phi1**2),
        (lambda z: np.exp(z) * (z - 1) / z**2, phi1 - phi2),
    ]


def worst_error(parameters, P, a, wanted):
    gamma, dv, mu = parameters
    if not (0.05 < gamma < 1.5 and 0 < dv < 1 and mu > 0):
        return 1.0
    z, weights = contour(parameters, P)
    resolvent = 1 / (z[:, None] - a[None, :])
    with np.errstate(all="ignore"):
        error = max(np.abs((weights * f(z)) @ resolvent - exact).max() for f, exact in wanted)
    return error if np.isfinite(error) else 1.0


def search(half_angle, P, kind):
    a = sector(half_angle)
    wanted = targets(kind, a)
    best = (1.0, None)
    for share in np.linspace(0.25, 0.95, 4):
        for spacing in (2.0, 3.0, 4.0):
            for mu in (0.1, 0.3, 0.6):
                start = [share * (np.pi / 2 - half_angle), spacing / P, mu * P]
                found = minimize(
                    lambda q: np.log(worst_error(q, P, a, wanted) + 1e-18),
                    start,
                    method="Nelder-Mead",
                    options={"maxiter": 300, "xatol": 1e-6, "fatol": 1e-3},
                )
                error = worst_error(found.x, P, a, wanted)
                if error < best[0]:
                    best = (error, found.x)
    return best


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("half_angle", type=float, help="degrees")
    parser.add_argument("P", type=int)
    arguments = parser.parse_args()
    for kind in ("window", "near"):
        error, (gamma, dv, mu) = search(np.radians(arguments.half_angle), arguments.P, kind)
        print(f"{kind}: gamma {gamma:.17g} dv {dv:.17g} mu {mu:.17g} worst error {error:.2g}")


if __name__ == "__main__":
    main()
