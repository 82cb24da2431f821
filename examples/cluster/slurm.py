"""Runs a command of Whitstone on workers that are jobs of Slurm.

    pip install 'whitstone[cluster]' dask-jobqueue
    python slurm.py --jobs 20 -- whitstone render classic.toml --set film.width=8000

The arguments after `--` are the command, without `--cluster`. The other classes of dask-jobqueue,
such as PBSCluster, take the same arguments as SLURMCluster.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from dask_jobqueue import SLURMCluster


def main() -> int:
    parser = argparse.ArgumentParser(description="Run a command of Whitstone on workers that Slurm starts.")
    parser.add_argument("--jobs", type=int, default=4, help="number of jobs, each with one worker (4)")
    parser.add_argument("--cores", type=int, default=8, help="cores of a job (8)")
    parser.add_argument("--memory", default="16GiB", help="memory of a job (16GiB)")
    parser.add_argument("--time", default="01:00:00", help="time limit of a job (01:00:00)")
    parser.add_argument("--interface", help="network interface of the scheduler and the workers, such as ib0")
    parser.add_argument("command", nargs="+", help="the command, such as: whitstone render SCENE")
    arguments = parser.parse_args()
    # A worker runs as many jobs of Whitstone at a time as it has threads, each in a process of its
    # own, so its memory is not that of the process that Dask would watch: Slurm watches it.
    with SLURMCluster(
        cores=arguments.cores,
        processes=1,
        memory=arguments.memory,
        walltime=arguments.time,
        interface=arguments.interface,
        job_script_prologue=["export DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE=False"],
    ) as cluster:
        cluster.scale(jobs=arguments.jobs)
        on_it = ["--cluster", cluster.scheduler_address, "--dask", sys.executable]
        return subprocess.run([*arguments.command, *on_it]).returncode


if __name__ == "__main__":
    sys.exit(main())
