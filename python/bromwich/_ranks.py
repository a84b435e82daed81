"""Ranks of an mpi4py communicator: the messages of the library, and the distribution of scenes."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np

from . import _core, _load
from ._errors import Error

TOGETHER = 1 << 28  # values per message: counts of MPI are of type int


class Ranks:
    """The operations of ``core/seam/communicator.hpp`` by mpi4py, on arrays of float64. All ranks call the same."""

    def __init__(self, comm: Any) -> None:
        from mpi4py import MPI

        self._mpi, self.comm = MPI, comm
        self.rank, self.size = int(comm.rank), int(comm.size)

    def shift(self, right: np.ndarray, left: np.ndarray) -> None:
        none = self._mpi.PROC_NULL
        after = self.rank + 1 if self.rank + 1 < self.size else none
        before = self.rank - 1 if self.rank > 0 else none
        sent, received = (right if after != none else right[:0]), (left if before != none else left[:0])
        for begin in range(0, max(sent.size, received.size), TOGETHER):
            part = slice(begin, begin + TOGETHER)
            self.comm.Sendrecv(sent[part], dest=after, recvbuf=received[part], source=before)

    def gather(self, values: np.ndarray, to: np.ndarray) -> None:
        self.comm.Allgather(values, to)

    def maximum(self, values: np.ndarray) -> None:
        self.comm.Allreduce(self._mpi.IN_PLACE, values, self._mpi.MAX)

    def broadcast(self, values: np.ndarray, root: int) -> None:
        for begin in range(0, values.size, TOGETHER):
            self.comm.Bcast(values[begin : begin + TOGETHER], root)

    def threads(self, asked: int) -> int:
        """Threads of one rank: the given number, or its share of the cores; the same on all ranks."""
        if asked == 0:
            asked = int(os.environ.get("OMP_NUM_THREADS", "0").split(",")[0] or 0)
        if asked == 0:
            here = self.comm.Split_type(self._mpi.COMM_TYPE_SHARED)
            cores, neighbours = len(os.sched_getaffinity(0)), here.size
            here.Free()
            bound = cores < (os.cpu_count() or 1)  # each rank is bound to its own cores
            asked = max(1, cores if bound else cores // neighbours)
        return self.comm.allreduce(asked, self._mpi.MIN)

    def number_here(self) -> int:
        """Which of the ranks of its machine this one is."""
        here = self.comm.Split_type(self._mpi.COMM_TYPE_SHARED)
        number = int(here.rank)
        here.Free()
        return number

    def together(self, work: Callable[[], Any]) -> Any:
        """Returns ``work()`` of this rank. If it raises on any rank, all ranks raise."""
        found, error = None, None
        try:
            found = work()
        except Exception as failure:  # any exception, since the other ranks wait
            error = failure
        failures = self.comm.allgather(None if error is None else f"{type(error).__name__}: {error}")
        if error is not None:
            raise error
        for rank, failure in enumerate(failures):
            if failure is not None:
                raise Error(f"ranks: rank {rank} failed: {failure}; see what differs there", "ranks")
        return found


def ranks_of(ranks: Any, stop: Any) -> Ranks | None:
    """The ranks of the argument ``ranks``; None for one rank."""
    if ranks is None:
        return None
    if not all(hasattr(ranks, name) for name in ("Allgather", "Sendrecv", "Split_type", "rank", "size")):
        raise Error(f"ranks: is a {type(ranks).__name__}; give a communicator of mpi4py, as MPI.COMM_WORLD", "ranks")
    if ranks.size == 1:
        return None
    if stop is not None:
        raise Error(f"stop: is given on {ranks.size} ranks, which stop together or not at all; leave it out", "stop")
    builds = ranks.allgather(f"bromwich {_core.version} ({_load.variant}, for {_core.built_for})")
    for rank, build in enumerate(builds):
        if build != builds[0]:
            raise Error(f"ranks: rank {rank} runs {build} and rank 0 {builds[0]}; install one package everywhere", "ranks")
    return Ranks(ranks)


class DealtAnswer:
    """Results of the scenes k with k % size = rank of every rank, in their order, with the members of ``_core.BatchAnswer``."""

    def __init__(self, own: Any, scenes: int, ranks: Ranks) -> None:
        everywhere = ranks.comm.allgather(
            [
                own.status,
                own.reason,
                own.warning,
                own.method,
                list(own.infeasible_at),
                (own.in_lanes, own.prepared, own.seconds),
            ]
        )
        self.scenes, self.backend, self.by_keyboard = scenes, own.backend, False
        self.x_components = own.x_components
        lists: list[list[Any]] = [[None] * scenes for _ in range(5)]
        for rank, (*found, _) in enumerate(everywhere):
            for whole, part in zip(lists, found):
                whole[rank :: ranks.size] = part
        self.status, self.reason, self.warning, self.method, self.infeasible_at = lists
        self.solved = [word == "solved" for word in self.status]
        self.in_lanes, self.prepared = (sum(found[-1][i] for found in everywhere) for i in (0, 1))
        self.seconds = max(found[-1][2] for found in everywhere)
        self.t = np.array(own.t)
        ranks.broadcast(self.t, 0)
        self.residual = self._whole(own.residual, ranks)
        self._rows = {name: self._whole(own.rows(name), ranks) for name in ("y", "w", "x")}

    def _whole(self, own: np.ndarray, ranks: Ranks) -> np.ndarray:
        width = own.size // len(range(ranks.rank, self.scenes, ranks.size))
        whole = np.empty((self.scenes, width))
        for rank in range(ranks.size):
            mine = rank == ranks.rank
            count = len(range(rank, self.scenes, ranks.size))
            part = np.ascontiguousarray(own).reshape(count, width).copy() if mine else np.empty((count, width))
            ranks.broadcast(part.reshape(-1), rank)
            whole[rank :: ranks.size] = part
        whole = whole.reshape(-1, *own.shape[1:])
        whole.flags.writeable = False
        return whole

    def rows(self, name: str) -> np.ndarray:
        return self._rows[name]
