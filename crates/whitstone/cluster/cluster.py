"""Runs jobs on a Dask cluster, for `--cluster` of the commands of Whitstone.

Reads a request, one line of JSON, from standard input, and ends as soon as standard input is
closed. Writes events to standard output, one line of JSON each:

    {"event": "started", "workers": 2}
    {"event": "finished", "id": "..."}                       its results are in the folder of results
    {"event": "failed", "id": "...", "reason": "..."}        after its allowed failures
    {"event": "refused", "worker": "...", "reason": "..."}   a worker that cannot run the jobs

The exit code is 0 if every job was finished or failed, and 3 otherwise, with a last event
{"event": "stopped", "reason": "..."}.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from pathlib import Path
from typing import Any

import dask
from distributed import Client, Future, LocalCluster, get_worker

# Seconds between looks at the workers.
TICK = 1.0
# Seconds until the first usable worker must be there, and until another replaces the last one.
PATIENCE = 60.0
# Seconds without a sign of life after which a local scheduler gives a worker up.
TIME_TO_LIVE = "60s"
# Characters of the output of a failed job that are reported.
LONGEST_REASON = 4000
# Bytes of that output that are kept.
LONGEST_LOG = 1 << 20
# Free bytes of a disk on which a job has failed that count as full.
LEAST_SPACE = 1 << 20


# On the workers. These functions travel with the tasks, so they use no value of this file.


def file_contents(data: bytes) -> bytes:
    """An input file as a task: it is sent to each worker once, and again if its workers are lost."""
    return data


def run_job(line: str, contents: list[bytes], settings: dict[str, Any]) -> dict[str, Any]:
    """Runs a job in a process of its own, and returns its results by name.

    Returns {"refused": reason} if this worker cannot run the jobs, and {"failed": reason,
    "final": whether it would fail everywhere} if the job gave no result.
    """
    started = time.perf_counter()
    worker = get_worker()
    base = Path(worker.local_directory) / "whitstone"
    job = json.loads(line)

    def replace(path: Path, data: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.replace(name, path)

    def program() -> list[str] | None:
        wanted = job["program"]
        named, installed = os.environ.get("WHITSTONE"), shutil.which("whitstone")
        if named:
            candidates = [[named]]
        else:
            candidates = [settings["command"], *([[installed]] if installed else [])]
        for command in candidates:
            try:
                state = os.stat(command[0])
            except OSError:
                found.append(f"{command[0]}: missing")
                continue
            # The answer of a program holds until its file changes.
            known = base / f"program-{state.st_dev}-{state.st_ino}-{state.st_mtime_ns}-{state.st_size}"
            try:
                identity = json.loads(known.read_text())
            except (OSError, ValueError):
                asked = subprocess.run(
                    [*command, "run-job", "--program"], stdin=subprocess.DEVNULL, capture_output=True, timeout=60
                )
                try:
                    identity = json.loads(asked.stdout)
                except ValueError:
                    found.append(f"{command[0]}: {asked.stderr.decode(errors='replace').strip()}")
                    continue
                replace(known, asked.stdout)
            if identity == wanted:
                return command
            found.append(f"{command[0]}: whitstone {identity.get('version')} ({identity.get('hash')})")
        return None

    def refused(reason: str) -> dict[str, Any]:
        return {"refused": reason, "worker": worker.address}

    found: list[str] = []
    # A folder for each set of files. Sets share the files by their contents.
    folder = base / "inputs" / settings["closure"]
    try:
        base.mkdir(parents=True, exist_ok=True)
        command = program()
        if command is None:
            wanted = job["program"]
            return refused(f"needs whitstone {wanted['version']} ({wanted['hash']}); found {', '.join(found)}")
        for file, data in zip(job["inputs"], contents):
            path, content = folder / file["path"], base / "files" / file["hash"]
            if path.exists():
                continue
            if not content.exists():
                replace(content, data)
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(content, path)
            except FileExistsError:
                # Another thread of this worker.
                pass
            except OSError:
                replace(path, data)
    except OSError as error:
        # A full disk, for example: no job can run here.
        return refused(f"cannot store its files: {error}")

    def watch(process: subprocess.Popen[bytes], ended: threading.Event) -> None:
        """Ends the process when its time is up, and when nobody waits for its result any more."""
        until = time.monotonic() + settings["time_limit"]
        while not ended.wait(min(0.5, max(0.0, until - time.monotonic()))):
            task = worker.state.tasks.get(settings["key"])
            if task is None or task.state == "cancelled" or time.monotonic() >= until:
                process.kill()
                return

    with tempfile.TemporaryDirectory(dir=base) as results:
        log = Path(results) / "log"
        with open(log, "wb") as output:
            process = subprocess.Popen(
                [*command, "run-job", "-", "--attached", "--inputs", str(folder), "--results", results]
                + ["--threads", str(settings["threads"]), "--target", str(base / "target")]
                + (["--mitsuba", settings["mitsuba"]] if settings["mitsuba"] else []),
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=output,
            )
            assert process.stdin is not None
            ended = threading.Event()
            threading.Thread(target=watch, args=(process, ended), daemon=True).start()
            begun = time.monotonic()
            try:
                # Standard input stays open: the process ends when it is closed, also because
                # this worker was killed.
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.write(line.encode() + b"\n")
                    process.stdin.flush()
                code = process.wait()
            finally:
                ended.set()
                process.kill()
                process.wait()
                with contextlib.suppress(BrokenPipeError):
                    process.stdin.close()
        if code == 0:
            files = {name: (Path(results) / name).read_bytes() for name in job["outputs"]}
            return {"files": files, "seconds": time.perf_counter() - started}
        whole = log.read_bytes()[-settings["longest_log"] :]
        text = whole.decode(errors="replace").strip()[-settings["longest"] :]
        if shutil.disk_usage(base).free < settings["least_space"]:
            return refused(f"has a full disk: {text}")
        if time.monotonic() - begun >= settings["time_limit"]:
            text = f"not finished after {settings['time_limit']} s (--job-time)\n{text}".strip()
        elif code < 0:
            text = f"the process was ended by signal {-code}\n{text}".strip()
        where = f"on {worker.address}: "
        return {"failed": where + (text or f"exit code {code}"), "final": code == 2, "log": whole}


def run_jobs(jobs: list[tuple[str, list[bytes], dict[str, Any]]]) -> list[dict[str, Any]]:
    """Runs jobs one after another; returns their outcomes, up to that of a refusal."""
    outcomes: list[dict[str, Any]] = []
    for line, contents, settings in jobs:
        outcomes.append(run_job(line, contents, settings))
        if "refused" in outcomes[-1]:
            break
    return outcomes


# On this side.


class Stopped(Exception):
    """Why no job can be run any more."""


def tell(event: str, **more: Any) -> None:
    print(json.dumps({"event": event, **more}), flush=True)


def write(path: Path, data: bytes) -> None:
    """Writes a file that is complete or unchanged."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".whitstone-", suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.chmod(name, 0o644)
        os.replace(name, path)
    except OSError:
        os.unlink(name)
        raise


def connect(request: dict[str, Any], stack: contextlib.ExitStack) -> Client:
    address = request["scheduler"]
    if address == "local":
        dask.config.set({"distributed.scheduler.worker-ttl": TIME_TO_LIVE})
        address = stack.enter_context(
            LocalCluster(
                n_workers=request["workers"],
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address=None,
                local_directory=request["scratch"],
            )
        )
    try:
        client = stack.enter_context(Client(address, timeout=15, set_as_default=False))
    except (OSError, TimeoutError, ValueError) as error:
        raise Stopped(f"cannot connect to the scheduler {request['scheduler']}: {error}") from error
    versions = client.get_versions()
    ours, theirs = (versions[side]["packages"]["distributed"] for side in ("client", "scheduler"))
    if ours != theirs:
        raise Stopped(
            f"the scheduler has distributed {theirs}, but this side has {ours}; "
            "name a Python with the same version with --dask"
        )
    return client


class Run:
    """The jobs of a request on a cluster."""

    def __init__(self, client: Client, request: dict[str, Any]) -> None:
        self.client = client
        self.results = Path(request["results"])
        self.allowed: int = request["retries"]
        self.priority: int = request["priority"]
        self.chunk: int = request["chunk"]
        self.lines: dict[str, str] = {json.loads(line)["id"]: line for line in request["jobs"]}
        self.ended: queue.SimpleQueue[Future] = queue.SimpleQueue()
        # The jobs of each task, and the workers that a task is limited to.
        self.tasks: dict[str, tuple[Future, list[str], set[str]]] = {}
        self.failures: dict[str, int] = {}
        self.refused: dict[str, str] = {}
        # Jobs for which there is no usable worker.
        self.waiting: list[str] = []
        self.token = uuid.uuid4().hex[:8]
        self.number = 0
        self.files: dict[str, Future] = {}
        # Of each job: its input files as tasks, and the name of their set.
        self.inputs: dict[str, tuple[list[Future], str]] = {}
        for id, line in self.lines.items():
            job = json.loads(line)
            inputs = job["inputs"]
            files = [self.file(Path(job["folder"]), file) for file in inputs]
            self.inputs[id] = files, uuid.uuid5(uuid.NAMESPACE_OID, json.dumps(inputs)).hex
        self.settings = {
            "command": request["command"],
            "threads": request["threads"],
            "time_limit": request["time_limit"],
            "longest": LONGEST_REASON,
            "longest_log": LONGEST_LOG,
            "least_space": LEAST_SPACE,
            "mitsuba": request["mitsuba"],
        }

    def file(self, folder: Path, file: dict[str, str]) -> Future:
        known = self.files.get(file["hash"])
        if known is None:
            data = (folder / file["path"]).read_bytes()
            key = f"whitstone-file-{file['hash']}"
            known = self.client.submit(file_contents, data, key=key)
            self.files[file["hash"]] = known
        return known

    def workers(self) -> set[str]:
        try:
            return set(self.client.scheduler_info(n_workers=-1)["workers"])
        except (OSError, TimeoutError) as error:
            raise Stopped("the scheduler is gone") from error

    def start(self, ids: list[str]) -> None:
        """Starts jobs as one task."""
        limited: set[str] = set()
        if self.refused:
            limited = self.workers() - set(self.refused)
            if not limited:
                self.waiting += ids
                return
        self.number += 1
        key = f"whitstone-{ids[0][:12]}-{self.token}-{self.number}"
        jobs = []
        for id in ids:
            files, closure = self.inputs[id]
            jobs.append((self.lines[id], files, {**self.settings, "closure": closure, "key": key}))
        future = self.client.submit(
            run_jobs, jobs, key=key, workers=list(limited) or None, priority=self.priority
        )
        self.tasks[future.key] = (future, ids, limited)
        future.add_done_callback(self.ended.put)

    def finish(self, future: Future) -> None:
        _, ids, _ = self.tasks.pop(future.key)
        if self.client.status != "running":
            raise Stopped("the scheduler is gone")
        try:
            outcomes = future.result(timeout=60)
        except Exception as error:
            # The worker was lost, with this and other tasks, more often than the scheduler allows.
            # Which of several jobs did it, if one did, shows when each runs alone.
            failed = {"failed": f"{type(error).__name__}: {error}", "final": False}
            outcomes = [failed] if len(ids) == 1 else []
        finally:
            future.release()
        for id, outcome in zip(ids, outcomes):
            self.judge(id, outcome)
        for id in ids[len(outcomes) :]:
            self.start([id])

    def judge(self, id: str, outcome: dict[str, Any]) -> None:
        """Takes the outcome of a job, and starts it again if there is no result."""
        if "files" in outcome:
            # The record is the last one.
            for name, data in outcome["files"].items():
                write(self.results / name, data)
            tell("finished", id=id, seconds=outcome["seconds"])
        elif "refused" in outcome:
            if outcome["worker"] not in self.refused:
                self.refused[outcome["worker"]] = outcome["refused"]
                tell("refused", worker=outcome["worker"], reason=outcome["refused"])
            self.start([id])
        else:
            self.failures[id] = self.failures.get(id, 0) + 1
            if outcome["final"] or self.failures[id] > self.allowed:
                if log := outcome.get("log"):
                    write(self.results / f"{id}.log", log)
                tell("failed", id=id, reason=outcome["failed"])
            else:
                self.start([id])

    def look(self) -> bool:
        """Restarts what cannot run where it was sent; returns whether a usable worker is there."""
        if self.client.status != "running":
            raise Stopped("the scheduler is gone")
        usable = self.workers() - set(self.refused)
        if usable:
            again, self.waiting = self.waiting, []
            for key, (future, ids, limited) in list(self.tasks.items()):
                if limited and not limited & usable:
                    del self.tasks[key]
                    future.cancel()
                    again += ids
            for id in again:
                self.start([id])
        return bool(usable)

    def run(self) -> None:
        all = list(self.lines)
        for first in range(0, len(all), self.chunk):
            self.start(all[first : first + self.chunk])
        usable = looked = time.monotonic()
        while self.tasks or self.waiting:
            with contextlib.suppress(queue.Empty):
                future = self.ended.get(timeout=TICK)
                # Cancelled ones have been replaced.
                if future.key in self.tasks:
                    self.finish(future)
            now = time.monotonic()
            if now - looked < TICK:
                continue
            looked = now
            if self.look():
                usable = now
            elif now - usable > PATIENCE:
                reasons = "".join(f"\n  {worker}: {reason}" for worker, reason in self.refused.items())
                raise Stopped(f"no usable worker for {PATIENCE:.0f} s{reasons}")


def main() -> int:
    request = json.loads(sys.stdin.readline())

    def watch() -> None:
        sys.stdin.read()
        # Workers of a local cluster end with this process, and their jobs with them.
        os._exit(143)

    threading.Thread(target=watch, daemon=True).start()
    with contextlib.ExitStack() as stack:
        try:
            run = Run(connect(request, stack), request)
            tell("started", workers=len(run.workers()))
            run.run()
        except (Stopped, OSError) as problem:
            tell("stopped", reason=str(problem))
            # Without waiting for connections to a scheduler that is gone.
            os._exit(3)
    return 0


if __name__ == "__main__":
    sys.exit(main())
