"""The package under mpirun with mpi4py; ranks_job.py is what the ranks run."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import bromwich
import pytest

pytest.importorskip("mpi4py", reason="mpi4py is not installed", exc_type=ImportError)
MPIRUN = shutil.which("mpirun")
pytestmark = pytest.mark.skipif(MPIRUN is None, reason="there is no mpirun (Debian: openmpi-bin)")


def job(ranks, *words_of_job):
    environment = dict(
        os.environ,
        OMP_NUM_THREADS="1",
        OMPI_ALLOW_RUN_AS_ROOT="1",
        OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1",
        OMPI_MCA_rmaps_base_oversubscribe="1",
        OMPI_MCA_hwloc_base_binding_policy="none",
        OMPI_MCA_btl_vader_single_copy_mechanism="none",
    )
    words = [MPIRUN, "-n", str(ranks), sys.executable, "-m", "mpi4py", str(Path(__file__).parent / "ranks_job.py"), *words_of_job]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=1800)
    if "mpirun" in done.stderr and "unrecognized" in done.stderr.lower():
        pytest.skip("this mpirun is none of Open MPI")
    return done


@pytest.mark.parametrize("ranks", [2, 3])
def test_the_solution_of_one_rank(ranks):
    done = job(ranks, "solves")
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(f"rank {r} of {ranks}: done" in done.stdout for r in range(ranks)), done.stdout


def test_a_device_of_each_rank():
    plugin = os.environ.get("BROMWICH_PRETENDED_CUDA", "")
    if not plugin:
        pytest.skip("BROMWICH_PRETENDED_CUDA is not set")
    done = job(3, "devices", plugin)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_rank_that_raises_ends_the_job():
    done = job(2, "lost")
    assert done.returncode != 0 and "lost on purpose" in done.stderr and "done" not in done.stdout


def test_one_rank_is_no_job(diode):
    from mpi4py import MPI

    alone = bromwich.solve(**diode, g="-sin(t)", ranks=MPI.COMM_SELF)
    assert alone.ok and (alone.y == bromwich.solve(**diode, g="-sin(t)").y).all()
