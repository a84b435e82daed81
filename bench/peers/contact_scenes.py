"""Chains of blocks on the ground, as files of scenes, as matrices, and the block of reference digits.

A block has a coordinate along the ground and one across; springs join neighbours along the ground. The load of a block goes
up and down, one after the other: with `lift` above 1 it lifts off and strikes.
"""
import pathlib

import numpy as np

mu = 0.4
# Of one block on a belt with the velocity 0.4, T = 10 and lift 1.3, by e: a flow with located events.
digits = {0.0: (-0.2276458679, 0.0644897728), 0.5: (-0.2024374329, 0.0637274032)}


class Chain:
    def __init__(self, blocks, e, lift=1.3, belt=0.0, T=4.0):
        self.blocks, self.e, self.lift, self.belt, self.T = blocks, e, lift, belt, T
        d = 2 * blocks
        self.K = np.zeros((d, d))
        for i in range(blocks):
            x, z = 2 * i, 2 * i + 1
            self.K[x, x] += 2
            self.K[z, z] += 1.5
            self.K[x, z] -= 0.6
            self.K[z, x] -= 0.6
            if i + 1 < blocks:
                self.K[x, x] += 1
                self.K[x + 2, x + 2] += 1
                self.K[x, x + 2] -= 1
                self.K[x + 2, x] -= 1
        self.C = 0.04 * np.eye(d) + 0.01 * self.K
        self.label = f"{blocks} block{'s' if blocks > 1 else ''}, e = {e:g}"

    def f(self, t):
        """len(t) x coordinates."""
        i = np.arange(self.blocks)
        f = np.empty((len(t), 2 * self.blocks))
        f[:, ::2] = 0.3 * np.sin(2.1 * t[:, None] + i)
        f[:, 1::2] = -1 + self.lift * np.cos(2.1 * t[:, None] + 0.7 * i)
        return f

    def write(self, folder):
        """A scene file; its path."""
        rows = lambda m: "[" + ", ".join("[" + ", ".join(f"{v:.17g}" for v in row) + "]" for row in m) + "]"
        f = ", ".join(
            f'"0.3*sin(2.1*t + {i})", "-1 + {self.lift}*cos(2.1*t + {0.7 * i:.17g})"' for i in range(self.blocks)
        )
        d = 2 * self.blocks
        unit = lambda k: "[" + ", ".join("1" if j == k else "0" for j in range(d)) + "]"
        contacts = "".join(
            f"[[contact]]\nnormal = {unit(2 * i + 1)}\ntangent = {unit(2 * i)}\nvelocity = {self.belt}\nmu = {mu}\n"
            f"restitution = {self.e}\n"
            for i in range(self.blocks)
        )
        path = pathlib.Path(folder) / f"chain-{self.blocks}-{self.e:g}-{self.lift:g}-{self.belt:g}.toml"
        path.write_text(
            f'name = "chain"\n[structure]\nM = 1\nK = {rows(self.K)}\nC = {rows(self.C)}\nf = [{f}]\n{contacts}[time]\nT = {self.T}\n'
        )
        return path
