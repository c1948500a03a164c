"""A Dask cluster of real processes on this machine."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

PROGRAM = """
import sys, dask
dask.config.set({"distributed.scheduler.allowed-failures": 1,
                 "distributed.worker.multiprocessing-method": "forkserver"})
from distributed import LocalCluster
from distributed.utils import get_mp_context
get_mp_context().set_forkserver_preload(["distributed", *sys.argv[1:]])
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
                      host="127.0.0.1") as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""

IMPORTED = (
    "cdrj_ros.evaluation.parallel", "cdrj_ros.commands.validate", "support.many_tasks",
)  # fmt: skip
"""What the tasks of the tests import; the workers are forks of a process that has done so."""


@contextmanager
def running_cluster(folder: Path) -> Iterator[str]:
    """The address of a scheduler with two workers, each replaced when it dies."""
    program = folder / "cluster.py"
    program.write_text(PROGRAM)
    support = Path(__file__).parents[1]
    path = f"{support}:{os.environ.get('PYTHONPATH', '')}"
    with subprocess.Popen(
        [sys.executable, str(program), *IMPORTED],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
    ) as cluster:
        assert cluster.stdout is not None
        assert cluster.stdin is not None
        yield cluster.stdout.readline().strip()
        children = psutil.Process(cluster.pid).children(recursive=True)
        cluster.stdin.close()
        cluster.wait(60.0)
    _, alive = psutil.wait_procs(children, timeout=60.0)
    assert not alive
