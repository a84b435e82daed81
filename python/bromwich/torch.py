"""Solves that PyTorch differentiates.

    from bromwich.torch import solve
    y, x, w = solve(A=A, B=B, N=N, M=M, x0=x0, T=1.0, g=g, steps=400)
    loss = (y - measured).square().sum()
    loss.backward()
"""

from __future__ import annotations

from typing import Any

import torch

from . import _differentiable as common


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, T: float, steps: int, method: str, threads: int, *data: torch.Tensor | None) -> tuple:
        arrays = dict(zip(common.DATA, (None if v is None else v.detach().cpu().double().numpy() for v in data)))
        result = common.solved(arrays, T, steps, method, threads)
        ctx.result, ctx.data = result, [None if v is None else (v.shape, v.dtype, v.device) for v in data]
        first = next(v for v in data if v is not None)
        return tuple(torch.from_numpy(v).to(first.device, first.dtype) for v in common.outputs(result))

    @staticmethod
    def backward(ctx: Any, *of: torch.Tensor) -> tuple:
        shapes = {name: None if d is None else tuple(d[0]) for name, d in zip(common.DATA, ctx.data)}
        bars = common.gradient(ctx.result.derivative(), shapes, tuple(v.detach().cpu().numpy() for v in of))
        return None, None, None, None, *(
            None if d is None else torch.from_numpy(bar).to(d[2], d[1]) for bar, d in zip(bars, ctx.data)
        )


def solve(
    *,
    A: torch.Tensor,
    B: torch.Tensor,
    N: torch.Tensor,
    M: torch.Tensor,
    x0: torch.Tensor,
    T: float,
    steps: int,
    f: torch.Tensor | None = None,
    g: torch.Tensor | None = None,
    method: str = "march",
    threads: int = 0,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """y (J+1) x n, x (J+1) x m and w (J+1) x n of a dense scene, computed in double precision on the host.

    Args:
        A, B, N, M, x0: m x m, m x n, n x m, n x n and m.
        f, g: (J+1) x m and (J+1) x n at the time points, linear between them; None: zero.
        T: final time. steps: J. method: ``"march"``, ``"contour"`` or ``"multigrid"``.

    Raises:
        NotSolved: there is no solution.
        Error: in ``backward``, where the solution is not differentiable; see :meth:`bromwich.Result.derivative`.
    """
    return _Solve.apply(float(T), int(steps), method, threads, x0, f, g, A, B, N, M)
