"""Processes of `worker.py`: each does a task at a time, and is replaced if it stops or hangs."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import fields
from typing import Any

import numpy as np

from latentmotion.errors import DiskFullError, InputError
from latentmotion.motion import Motion
from latentmotion.service.batching import NICE
from latentmotion.service.problems import Problem

_TASKS_OF_A_PROCESS = 1000
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkerError(Exception):
    """The process ended, or took too long, in the middle of a task.

    Args:
        problem: What happened.
        ended: Whether it ended, so that another may do the task.
    """

    def __init__(self, problem: str, ended: bool) -> None:
        super().__init__(problem)
        self.ended = ended


class FileWorkers:
    """Some processes, and a bounded number of tasks that wait for them.

    Args:
        count: Number of processes.
        waiting: Tasks that wait at most.
        tries: Processes that may end in the middle of a task before it is given up.
    """

    def __init__(self, count: int, waiting: int, tries: int = 1) -> None:
        self._idle: asyncio.Queue[Process | None] = asyncio.Queue()
        self._tasks = 0
        self._most = count + waiting
        self._tries, self._stopped = tries, False
        self._started: set[Process] = set()
        self._done: dict[int, int] = {}
        for _ in range(count):
            self._idle.put_nowait(None)

    async def run(
        self, task: dict[str, Any], content: bytes = b"", seconds: float = 60.0
    ) -> tuple[dict[str, Any], bytes]:
        """Returns the answer to a task.

        Args:
            task: What to do, see `worker.py`.
            content: Bytes that belong to it.
            seconds: Time that it may take once a process has it.

        Raises:
            Problem: 429, too many tasks wait.
            DiskFullError: There is no room for what it writes.
            InputError: The task cannot be done.
            WorkerError: It took too long, or as many processes ended as may.
        """
        if self._tasks >= self._most:
            raise Problem(429, "too many files are being worked on; try again", 1.0)
        self._tasks += 1
        # A client that goes does not stop the process, whose answer would come to the next.
        work = asyncio.ensure_future(self._run(task, content, seconds))
        work.add_done_callback(self._finished)
        return await asyncio.shield(work)

    async def start(self) -> None:
        """Starts all processes now; without it, each is started by its first task."""
        for _ in range(self._idle.qsize()):
            self._idle.put_nowait(self._idle.get_nowait() or await self._start())

    async def stop(self) -> None:
        """Ends all processes, and starts no more."""
        self._stopped = True
        for process in tuple(self._started):
            await self._end(process)

    def _finished(self, work: asyncio.Future[Any]) -> None:
        self._tasks -= 1
        if not work.cancelled():
            work.exception()

    async def _run(
        self, task: dict[str, Any], content: bytes, seconds: float
    ) -> tuple[dict[str, Any], bytes]:
        for _ in range(self._tries - 1):
            try:
                return await self._tried(task, content, seconds)
            except WorkerError as error:
                if self._stopped or not error.ended:
                    raise
        return await self._tried(task, content, seconds)

    async def _tried(
        self, task: dict[str, Any], content: bytes, seconds: float
    ) -> tuple[dict[str, Any], bytes]:
        process = await self._idle.get()
        try:
            if process is not None and process.returncode is not None:
                process = await self._end(process)
            process = process or await self._start()
            async with asyncio.timeout(seconds):
                head, found = await _exchange(process, task, content)
        except (TimeoutError, OSError, asyncio.IncompleteReadError, ValueError) as error:
            if process is not None:
                process = await self._end(process)
            if isinstance(error, TimeoutError):
                raise WorkerError(f"not done in {seconds:g} s", ended=False) from error
            times = f" {self._tries} times" if self._tries > 1 else ""
            raise WorkerError(f"the process that works on it ended{times}", True) from error
        finally:
            self._idle.put_nowait(await self._kept(process))
        if "full" in head:
            raise DiskFullError(head["full"])
        if "error" in head:
            raise InputError(head["error"])
        if "failure" in head:
            raise RuntimeError(head["failure"])
        return head, found

    async def _kept(self, process: Process | None) -> Process | None:
        """Ends a process that has done many tasks, so that none grows without end."""
        if process is None:
            return None
        self._done[process.pid] = self._done.get(process.pid, 0) + 1
        if self._done[process.pid] < _TASKS_OF_A_PROCESS:
            return process
        return await self._end(process)

    async def _start(self) -> Process:
        places = {"PYTHONPATH": os.pathsep.join(sys.path)}
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "latentmotion.service.worker"),
            stdin=PIPE,
            stdout=PIPE,
            env=os.environ | _ONE_THREAD | places,
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


def written(
    motions: Sequence[Motion], form: str, clean: bool, fps: float | None
) -> tuple[dict[str, Any], bytes]:
    """Returns the task that makes a file of motions, and the bytes that belong to it."""
    about = [
        {
            "frames": len(motion),
            "fps": motion.fps,
            "caption": motion.caption,
            "metadata": dict(motion.metadata),
            "skeleton": {
                one.name: value.tolist() if isinstance(value, np.ndarray) else value
                for one in fields(motion.skeleton)
                for value in [getattr(motion.skeleton, one.name)]
            },
        }
        for motion in motions
    ]
    content = b"".join(motion.joints.astype("<f4", copy=False).tobytes() for motion in motions)
    return {"verb": "write", "motions": about, "clean": clean, "fps": fps, "format": form}, content


async def _exchange(
    process: Process, task: dict[str, Any], content: bytes
) -> tuple[dict[str, Any], bytes]:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(json.dumps({**task, "size": len(content)}).encode() + b"\n" + content)
    await process.stdin.drain()
    head = json.loads(await process.stdout.readuntil(b"\n"))
    return head, await process.stdout.readexactly(head["size"])
