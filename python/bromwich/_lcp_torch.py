"""Complementarity problems that PyTorch differentiates."""

from __future__ import annotations

from typing import Any

import torch

from ._errors import Error
from ._lcp import DEGENERATE
from ._lcp_differentiable import outputs, require_failed


class _Solution(torch.autograd.Function):
    """y, w, status and margin."""

    @staticmethod
    def forward(how: tuple, M: torch.Tensor, q: torch.Tensor) -> tuple:
        kind = torch.promote_types(M.dtype, q.dtype)
        found = outputs(how, *(v.detach().cpu().double().numpy() for v in (M, q)))
        return tuple(torch.as_tensor(v, dtype=kind, device=q.device) for v in found)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple, output: tuple) -> None:
        how, M, q = inputs
        y, _, status, margin = output
        ctx.how, ctx.shapes = how, (M.shape, q.shape)
        ctx.mark_non_differentiable(status, margin)
        ctx.save_for_backward(M, y, status, margin)
        ctx.save_for_forward(M, y, status, margin)

    @staticmethod
    def backward(ctx: Any, of_y: torch.Tensor, of_w: torch.Tensor, *_: Any) -> tuple:
        M, y, S, K, kept = _held(ctx)
        of_w = (1 - S) * of_w
        right = S * (of_y + (M.mT @ of_w[..., None])[..., 0])
        of_q = (of_w - S * torch.linalg.solve(K.mT, right[..., None])[..., 0]) * kept
        return None, _summed(of_q[..., :, None] * y[..., None, :], ctx.shapes[0]), _summed(of_q, ctx.shapes[1])

    @staticmethod
    def jvp(ctx: Any, _: Any, dM: torch.Tensor | None, dq: torch.Tensor | None) -> tuple:
        M, y, S, K, kept = _held(ctx)
        change = torch.zeros_like(y)
        change = change if dq is None else change + dq
        change = change if dM is None else change + (dM @ y[..., None])[..., 0]
        dy = -torch.linalg.solve(K, (S * change)[..., None])[..., 0]
        dw = (1 - S) * ((M @ dy[..., None])[..., 0] + change)
        return dy * kept, dw * kept, None, None

    @staticmethod
    def vmap(info: Any, in_dims: tuple, how: tuple, M: torch.Tensor, q: torch.Tensor) -> tuple:
        dims = in_dims[1:]
        most = max(v.ndim - k - (d is not None) for v, d, k in zip((M, q), dims, (2, 1)))
        first = []
        for v, d, k in zip((M, q), dims, (2, 1)):
            v = v[None] if d is None else v.movedim(d, 0)
            first.append(v.reshape(v.shape[0], *(1,) * (most + k + 1 - v.ndim), *v.shape[1:]))
        found = _Solution.apply(how, *first)
        return tuple(v.expand(info.batch_size, *v.shape[1:]) for v in found), (0, 0, 0, 0)


def _held(ctx: Any) -> tuple:
    """M, y, the active sets, the matrix M_SS with the identity beside it, and the factor of each problem."""
    M, y, status, margin = ctx.saved_tensors
    good = ((status == 0) & (margin > DEGENERATE))[..., None]
    y = torch.where(good, y, 0.0)
    S = (y > 0).to(y.dtype)
    eye = torch.eye(y.shape[-1], dtype=y.dtype, device=y.device)
    K = S[..., :, None] * M * S[..., None, :] + eye * (1 - S)[..., :, None]
    kept = torch.where(good, 1.0, 0.0 if ctx.how[1] == "zero" else torch.nan).to(y.dtype)
    return M.to(y.dtype), y, S, K, kept


def _summed(bar: torch.Tensor, shape: torch.Size) -> torch.Tensor:
    return bar.sum_to_size(shape)


def lcp(
    M: torch.Tensor, q: torch.Tensor, *, lcp_class: str = "auto", failed: str = "raise", threads: int = 0
) -> tuple[torch.Tensor, ...]:
    """y and w of ``0 <= y  ⊥  w = M y + q >= 0`` (:func:`bromwich.lcp`), solved on the host in double precision. M is n x n and
    q has n values, or both have leading axes for problems that are solved together; ``torch.vmap`` adds one. The derivative
    holds the active sets.

    Args:
        lcp_class: as :func:`bromwich.lcp` takes it.
        failed: what a problem without a solution does. ``"raise"``: it raises an error; derivatives of degenerate problems
            are NaN. ``"nan"``, ``"zero"``: its y and w are NaN, derivatives of it, and of degenerate problems, are NaN or 0, and
            a third tensor is returned: 0 where the problem is solved, otherwise an index of ``LCP_STATUSES``.
        threads: of the host; 0: all.
    """
    require_failed(failed)
    for name, v in (("M", M), ("q", q)):
        if not isinstance(v, torch.Tensor):
            raise Error(f"{name}: is a {type(v).__name__}; give a torch.Tensor", name)
        if v.is_complex():
            raise Error(f"{name}: is complex; give real numbers", name)
    M, q = (v if v.is_floating_point() else v.double() for v in (M, q))
    if M.ndim < 2 or M.shape[-1] != M.shape[-2] or q.ndim < 1 or q.shape[-1] != M.shape[-1]:
        raise Error(f"M: has shape {tuple(M.shape)}, and q {tuple(q.shape)}; give n x n and n, or more axes before", "M")
    y, w, status, _ = _Solution.apply((lcp_class, failed, threads), M, q)
    return (y, w) if failed == "raise" else (y, w, status.to(torch.int32))
