"""Processes of `worker.py`: each does what waits, and is replaced if it stops or hangs."""

from __future__ import annotations

import asyncio
import json
import os
import time
from asyncio.subprocess import PIPE, Process
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from latentmotion.errors import DiskFullError, InputError
from latentmotion.pipeline import RawMotion
from latentmotion.service.batching import CLIENT, NICE, Turns, room
from latentmotion.service.metrics import Metrics
from latentmotion.service.problems import Problem
from latentmotion.storage import children
from latentmotion.storage.configuration import to_json

_TASKS_OF_A_PROCESS = 1000
# Motions that a process cleans up and writes together at most.
_TOGETHER = 8

Answer = tuple[dict[str, Any], bytes]


class WorkerError(Exception):
    """The process ended, or took too long, in the middle of a task."""


@dataclass(eq=False)
class _FileTask:
    """A task that waits for a process or is worked on."""

    task: dict[str, Any]
    content: bytes
    until: float  # Deadline, on the clock of `time.monotonic`.
    done: asyncio.Future[Answer]
    client: str = field(default_factory=CLIENT.get)
    started: bool = False  # Whether a process works on it.
    ended: int = 0  # Number of processes that died of it.

    @property
    def joins(self) -> bool:
        """Whether it may share a batch: it writes one motion, and no process has died of it."""
        return not self.ended and len(self.task.get("motions", ())) == 1


class FileWorkers:
    """Some processes, and a bounded number of tasks that wait for them.

    Args:
        count: Number of processes.
        waiting: Tasks that wait at most.
        metrics: Counts the refused.
        tries: Processes that may end in the middle of a task before it is given up.
    """

    def __init__(self, count: int, waiting: int, metrics: Metrics, tries: int = 1) -> None:
        self._idle: asyncio.Queue[Process | None] = asyncio.Queue()
        self._waiting: deque[_FileTask] = deque()
        self._tasks, self._turns, self._places = Counter[str](), Turns(), 0
        self._count, self._most = count, count + waiting
        self._metrics, self._tries, self._stopped = metrics, tries, False
        # Seconds per task until one was timed, for the estimate of `Retry-After`.
        self._seconds_each = 0.05
        self._started: set[Process] = set()
        self._done: dict[int, int] = {}
        self._work: set[asyncio.Task[None]] = set()
        for _ in range(count):
            self._idle.put_nowait(None)

    @contextmanager
    def place(self, seconds: float) -> Iterator[None]:
        """Reserves a place for a task whose motion is still to be generated.

        Args:
            seconds: Time until when its answer is wanted.

        Raises:
            Problem: 429, those before it would take longer than that.
        """
        wait = self._seconds_each * (self._places + 1) / self._count
        if self._places >= self._count and wait > seconds:
            self._metrics.shed.labels("files late").inc()
            detail = f"{self._places} files are asked for, and more would not be done in time"
            raise Problem(429, f"{detail}; try again later", wait)
        self._places += 1
        try:
            yield
        finally:
            self._places -= 1

    async def run(
        self, task: dict[str, Any], content: bytes = b"", seconds: float = 60.0
    ) -> Answer:
        """Returns the answer to a task.

        Args:
            task: The task as plain values, see `worker.py`.
            content: Bytes that belong to it.
            seconds: Time until when it is wanted.

        Raises:
            Problem: 429, too many tasks wait; 503, its time was over before a process had it.
            DiskFullError: There is no room for what it writes.
            InputError: The task cannot be done.
            WorkerError: It took too long, or as many processes ended as may.
        """
        if not room(self._tasks, self._most, CLIENT.get()):
            self._metrics.shed.labels("files full").inc()
            raise Problem(429, "too many files are being worked on; try again", 1.0)
        done: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        job = _FileTask(task, content, time.monotonic() + seconds, done)
        self._tasks[job.client] += 1

        def finished(done: asyncio.Future[Answer]) -> None:
            self._tasks[job.client] -= 1
            self._tasks += Counter()  # drops clients that have none
            if not done.cancelled():
                done.exception()

        done.add_done_callback(finished)
        self._add(job)
        try:
            # A client that goes does not stop the process, whose answer would come to the next.
            async with asyncio.timeout(seconds):
                head, file = await asyncio.shield(done)
        except TimeoutError:
            if job.started:
                raise WorkerError("not done in time") from None
            self._metrics.shed.labels("files late").inc()
            detail = "the files of others were not done in time; try again"
            raise Problem(503, detail, 1.0) from None
        finally:
            if not job.started:
                done.cancel()
        if "full" in head:
            raise DiskFullError(head["full"])
        if "error" in head:
            raise InputError(head["error"])
        if "failure" in head:
            raise RuntimeError(head["failure"])
        return head, file

    async def start(self) -> None:
        """Starts all processes now; without it, each is started by its first task."""
        for _ in range(self._idle.qsize()):
            self._idle.put_nowait(self._idle.get_nowait() or await self._start())

    async def stop(self) -> None:
        """Ends all processes, and starts no more."""
        self._stopped = True
        for process in tuple(self._started):
            await self._end(process)

    def _add(self, job: _FileTask) -> None:
        self._waiting.append(job)
        work = asyncio.ensure_future(self._run_waiting())
        self._work.add(work)
        work.add_done_callback(self._work.discard)

    async def _run_waiting(self) -> None:
        process = await self._idle.get()
        # The next task and those that may join it, so many that all processes get some.
        waiting = self._turns.order(job for job in self._waiting if not job.done.done())
        most = min(_TOGETHER, -(-len(waiting) // self._count))
        batch = waiting[:1]
        if batch and batch[0].joins:
            batch += [job for job in waiting[1:] if job.joins][: most - 1]
        self._waiting = deque(job for job in self._waiting if job in waiting and job not in batch)
        self._turns.served(batch)
        try:
            if batch:
                process = await self._run_batch(process, batch)
        finally:
            self._idle.put_nowait(process)

    async def _run_batch(
        self, process: Process | None, batch: Sequence[_FileTask]
    ) -> Process | None:
        """Runs tasks on a process, or on a new one; returns the process unless it has to end."""
        for job in batch:
            job.started = True
        try:
            if process is not None and process.returncode is not None:
                process = await self._end(process)
            process, began = process or await self._start(), time.monotonic()
            async with asyncio.timeout(max(job.until for job in batch) - began):
                answers = await _exchange(process, [(job.task, job.content) for job in batch])
        except (TimeoutError, OSError, asyncio.IncompleteReadError, ValueError) as error:
            if process is not None:
                await self._end(process)
            times = f" {self._tries} times" if self._tries > 1 else ""
            problem = f"the process that works on it ended{times}"
            if late := isinstance(error, TimeoutError):
                problem = "not done in time"
            for job in [job for job in batch if not job.done.done()]:
                job.ended += 1
                if late or self._stopped or job.ended >= self._tries:
                    job.done.set_exception(WorkerError(problem))
                else:
                    self._add(job)  # again, alone
            return None
        each = (time.monotonic() - began) / len(batch)
        self._seconds_each += 0.1 * (each - self._seconds_each)
        for job, answer in zip(batch, answers, strict=True):
            if not job.done.done():
                job.done.set_result(answer)
        # Ended after a fixed number of tasks, so that leaks of libraries stay bounded.
        self._done[process.pid] = self._done.get(process.pid, 0) + len(batch)
        full = self._done[process.pid] >= _TASKS_OF_A_PROCESS
        return await self._end(process) if full else process

    async def _start(self) -> Process:
        process = await asyncio.create_subprocess_exec(
            *children.command("latentmotion.service.worker"),
            stdin=PIPE,
            stdout=PIPE,
            limit=_BUFFER,
            env=children.environment(),
            start_new_session=True,  # Ctrl+C ends the service first
        )
        with suppress(ProcessLookupError):
            os.setpriority(os.PRIO_PROCESS, process.pid, NICE)
        self._started.add(process)
        return process

    async def _end(self, process: Process) -> None:
        self._started.discard(process)
        self._done.pop(process.pid, None)
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
        if process.stdin is not None:
            process.stdin.close()


# Bytes of answers that are read before someone waits for them.
_BUFFER = 1 << 20


def written(raw: Sequence[RawMotion], form: str, clean: bool, fps: float | None) -> Answer:
    """Returns the task that makes a file of motions, and the bytes that belong to it."""
    heads = [
        {
            "frames": len(item.motion),
            "fps": item.motion.fps,
            "caption": item.motion.caption,
            "metadata": dict(item.motion.metadata),
            "skeleton": json.dumps(asdict(item.motion.skeleton), default=np.ndarray.tolist),
            "corrections": to_json(item.corrections),
        }
        for item in raw
    ]
    content = b"".join(item.motion.joints.astype("<f4", copy=False).tobytes() for item in raw)
    return {"verb": "write", "motions": heads, "clean": clean, "fps": fps, "format": form}, content


async def _exchange(process: Process, batch: Sequence[Answer]) -> list[Answer]:
    assert process.stdin is not None and process.stdout is not None
    tasks = [{**task, "size": len(content)} for task, content in batch]
    process.stdin.write(json.dumps(tasks).encode() + b"\n")
    process.stdin.writelines(content for _, content in batch)
    await process.stdin.drain()
    heads = json.loads(await process.stdout.readuntil(b"\n"))
    return [(head, await process.stdout.readexactly(head["size"])) for head in heads]
