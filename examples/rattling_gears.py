#!/usr/bin/env python3
"""Rattling gears of one design, whose teeth have scattered friction and restitution: how far their places scatter, and why.

    python3 examples/rattling_gears.py [--gears 200] [--end 12] [--seed 1]

A loose helical wheel, in coordinates that turn with the driving one: its rotation r between two flanks and its axial place z,

    r'' + 0.1 r' + 0.2 r - 0.5 z = 2 cos 2t + l1 - l2,    z'' + 0.1 z' + 2 z - 0.5 r = t1 + t2,    |r| <= 0.5,

with Coulomb's friction |t_i| <= mu l_i of teeth that slide along each other with 0.3, and Newton's law of impact with e. One call
solves all gears, another one differentiates r(T) by mu and e, through all impacts. Gears without a derivative, as where an impact only
touches, are left out.
"""
import argparse

import numpy as np

import bromwich


def gear(mu, e, T=12.0):
    flanks = [
        bromwich.Contact(normal=[side, 0], gap=0.5, tangent=[0, 1], velocity=0.3, mu=mu, restitution=e, name=name)
        for side, name in ((1, "front"), (-1, "back"))
    ]
    wheel = bromwich.Structure(
        M=np.eye(2), C=0.1 * np.eye(2), K=[[0.2, -0.5], [-0.5, 2.0]], f=["2*cos(2*t)", "0"], contacts=flanks, names=["r", "z"]
    )
    return wheel.scene(T=T)


def gears(mus, es, T, threads=0):
    """Results at 0, T/2 and T, and their derivatives by mu and e."""
    found = bromwich.solve_batch([gear(mu, e, T) for mu, e in zip(mus, es)], tol=1e-6, times=[0, T / 2, T], states="all")
    by = found.derivative(parameters={"mu": mus, "e": es}, scene_of=lambda mu, e: gear(mu, e, T), threads=threads)
    return found, by


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gears", type=int, default=200)
    parser.add_argument("--end", type=float, default=12.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    spread = {"mu": 0.01, "e": 0.01}
    mus = 0.2 + spread["mu"] * random.normal(size=options.gears)
    es = np.clip(0.7 + spread["e"] * random.normal(size=options.gears), 0, 1)
    found, slopes = gears(mus, es, options.end)
    there = found.ok & slopes.ok
    r = found.x[there, -1, 0]
    print(f"{int(found.ok.sum())} of {options.gears} solved, {int(slopes.ok.sum())} with derivatives")
    for reason in sorted(set(reason.split(" at t")[0] for reason in slopes.reason if reason)):
        print("  without:", reason)
    print(f"r(T) = {r.mean():.4f} +- {r.std():.4f}")
    for name, by in slopes.by.items():
        slope = by.x[there, -1, 0]
        print(f"  by {name}: slopes of {slope.mean():.3f} on the average, {abs(slope).max():.2f} at most, "
              f"which makes +- {np.median(abs(slope)) * spread[name]:.4f}")


if __name__ == "__main__":
    main()
