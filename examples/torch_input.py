"""Chooses the force on a mass that meets a stop, so that it is at 0.8 at t = 1: gradients by PyTorch.

    pip install torch
    python examples/torch_input.py
"""

import torch
from bromwich.torch import solve

force = torch.zeros(401, 1, dtype=torch.float64, requires_grad=True)  # an input to be chosen
A, B, N, M = (torch.tensor(v, dtype=torch.float64) for v in ([[0, 1], [-4, -0.5]], [[0], [1]], [[1, 0]], [[0.1]]))
optimizer = torch.optim.LBFGS([force], line_search_fn="strong_wolfe")


def distance():
    optimizer.zero_grad()
    push = torch.cat([torch.zeros_like(force), force], dim=1)
    y, x, w = solve(A=A, B=B, N=N, M=M, x0=torch.tensor([0.5, 0.0]).double(), f=push, T=1.0, steps=400)
    loss = (x[-1, 0] - 0.8) ** 2 + 1e-4 * force.square().mean()  # reach 0.8 at t = 1 with little force
    loss.backward()
    return loss


optimizer.step(distance)
print(f"distance and effort {distance().item():.2e}, largest force {force.abs().max().item():.2f}")
