#!/usr/bin/python3
"""Chains of blocks on the ground as users of Siconos write them: Moreau-Jean with theta = 1/2, planar friction.

siconos_blocks.py BLOCKS E STEPS SECONDS RESULT: writes q at all steps, and prints one line of JSON. It stops after SECONDS.
"""
import json
import sys
import time

import numpy as np
import siconos.kernel as kernel
import siconos.numerics as numerics

from contact_scenes import Chain, mu


def model_of(chain, steps):
    d = 2 * chain.blocks
    force = kernel.SiconosVector(d)
    system = kernel.LagrangianLinearTIDS(np.zeros(d), np.zeros(d), np.eye(d), chain.K, chain.C)
    system.setFExtPtr(force)
    model = kernel.NonSmoothDynamicalSystem(0, chain.T)
    model.insertDynamicalSystem(system)
    law = kernel.NewtonImpactFrictionNSL(chain.e, 0, mu, 2)
    for i in range(chain.blocks):
        H = np.zeros((2, d))
        H[0, 2 * i + 1] = H[1, 2 * i] = 1
        model.link(kernel.Interaction(law, kernel.LagrangianLinearTIR(H)), system)
    problem = kernel.FrictionContact(2, numerics.SICONOS_FRICTION_2D_NSGS)
    problem.numericsSolverOptions().iparam[0] = 10000
    problem.numericsSolverOptions().dparam[0] = 1e-8
    grid = kernel.TimeDiscretisation(0, chain.T / steps)
    simulation = kernel.TimeStepping(model, grid, kernel.MoreauJeanOSI(0.5), problem)
    simulation.setNewtonOptions(kernel.SICONOS_TS_LINEAR)
    return simulation, system, force


def main(blocks, e, steps, seconds, result):
    chain, steps = Chain(int(blocks), float(e)), int(steps)
    loads = chain.f(chain.T * np.arange(steps + 1) / steps)
    means = (loads[1:] + loads[:-1]) / 2
    start = time.perf_counter()
    simulation, system, force = model_of(chain, steps)
    simulation.initialize()
    q = np.empty((steps, 2 * chain.blocks))
    setup = time.perf_counter()
    done = 0
    for j in range(steps):
        for k, value in enumerate(means[j]):
            force.setValue(k, value)
        simulation.computeOneStep()
        q[j] = system.q()
        simulation.nextStep()
        done = j + 1
        if time.perf_counter() - setup > float(seconds):
            break
    end = time.perf_counter()
    q[:done].tofile(result)
    print(json.dumps({"total": end - start, "setup": setup - start, "steps": done}))


if __name__ == "__main__":
    main(*sys.argv[1:])
