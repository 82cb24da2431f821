"""Measures what the scheduler of Dask costs, with workers that only wait.

    scheduler.py tasks WORKERS TASKS SECONDS BYTES   tasks that take SECONDS and return BYTES
    scheduler.py file WORKERS BYTES                  a file that every worker gets
    scheduler.py workers ADDRESS COUNT               the workers, in one process, until it is killed

The first two start a scheduler and workers as processes of their own, and write one line of JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import dask
from distributed import Client, Worker, as_completed, wait

# Workers that start at a time.
AT_A_TIME = 50


async def workers(address: str, count: int) -> None:
    # What every worker does by itself, twice a second and more often, would be all that a process
    # with many of them does.
    dask.config.set(
        {
            "distributed.admin.system-monitor.interval": "1h",
            "distributed.admin.tick.interval": "1h",
            "distributed.worker.profile.enabled": False,
        }
    )
    with tempfile.TemporaryDirectory() as folder:
        all = [
            Worker(address, nthreads=1, local_directory=folder, dashboard=False, heartbeat_interval="5s", memory_limit=0)
            for _ in range(count)
        ]
        for first in range(0, count, AT_A_TIME):
            await asyncio.gather(*all[first : first + AT_A_TIME])
        print("ready", flush=True)
        await asyncio.gather(*(worker.finished() for worker in all))


async def stub(seconds: float, size: int) -> bytes:
    """A job: it waits, and returns as many bytes as a result has."""
    await asyncio.sleep(seconds)
    return bytes(size)


def contents(data: bytes) -> bytes:
    return data


def length(data: bytes) -> int:
    return len(data)


def processor_time(process: int) -> float:
    """In seconds."""
    fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextlib.contextmanager
def cluster(count: int) -> Iterator[tuple[Client, int]]:
    """A client of a scheduler with workers, and the process of the scheduler."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        file = Path(folder) / "scheduler.json"
        command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
        command += ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)]
        scheduler = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        stack.callback(scheduler.kill)
        text = ""
        while not text.endswith("}"):
            time.sleep(0.05)
            text = file.read_text().strip() if file.exists() else ""
        address = json.loads(text)["address"]
        stubs = subprocess.Popen(
            [sys.executable, __file__, "workers", address, str(count)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        stack.callback(stubs.kill)
        assert stubs.stdout is not None
        stubs.stdout.readline()
        client = stack.enter_context(Client(address))
        client.wait_for_workers(count)
        yield client, scheduler.pid


def tasks(count: int, number: int, seconds: float, size: int) -> dict[str, float]:
    with cluster(count) as (client, scheduler):
        client.gather([client.submit(stub, 0, 0, key=f"first-{k}") for k in range(count)])
        before = processor_time(scheduler), processor_time(os.getpid())
        begin = time.perf_counter()
        futures = [client.submit(stub, seconds, size, key=f"stub-{k}") for k in range(number)]
        for future in as_completed(futures):
            future.result()
            future.release()
        elapsed = time.perf_counter() - begin
        after = processor_time(scheduler), processor_time(os.getpid())
    return {
        "workers": count,
        "tasks": number,
        "task_s": seconds,
        "bytes": size,
        "elapsed_s": elapsed,
        "scheduler_s": (after[0] - before[0]) / number,
        "client_s": (after[1] - before[1]) / number,
    }


def file(count: int, size: int) -> dict[str, float]:
    data = os.urandom(size)
    with cluster(count) as (client, _):
        names = list(client.scheduler_info(n_workers=-1)["workers"])
        begin = time.perf_counter()
        future = client.submit(contents, data, key="file")
        wait([future])
        sent = time.perf_counter() - begin
        # As the jobs of `--cluster` do: each needs the file.
        wait([client.submit(length, future, key=f"length-{name}", workers=[name]) for name in names])
        return {"workers": count, "bytes": size, "first_s": sent, "all_s": time.perf_counter() - begin}


def main() -> int:
    match sys.argv[1:]:
        case ["workers", address, count]:
            asyncio.run(workers(address, int(count)))
        case ["tasks", count, number, seconds, size]:
            print(json.dumps(tasks(int(count), int(number), float(seconds), int(size))))
        case ["file", count, size]:
            print(json.dumps(file(int(count), int(size))))
        case _:
            print(__doc__, file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
