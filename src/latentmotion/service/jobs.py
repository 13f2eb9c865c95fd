"""Jobs: many motions generated in the background, in a folder that outlives the process.

    FOLDER/ID/request.json   what is asked for
              client         whose it is, where the service tells clients apart
              lock           held by the process that works on it, until that ends in any way
              00000.npz …    motions that are there, some in each
              error          why it failed
              answer.FORMAT  the result

Replicas may share the folder: what a killed one left is taken up by the next that looks, and a
motion is the same whoever makes it.
"""

from __future__ import annotations

import asyncio
import fcntl
import secrets
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter
from fastapi import Path as InPath
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, JSONResponse, Response
from pydantic import ValidationError

from latentmotion.errors import LatentMotionError
from latentmotion.formats import MEDIA_TYPES
from latentmotion.service.batching import CLIENT, Turns, check, room
from latentmotion.service.problems import Problem
from latentmotion.service.schemas import BatchRequest, JobState
from latentmotion.service.state import Service
from latentmotion.storage.files import is_disk_full, write_file

MOST = 1000  # Most jobs in the folder, finished ones included.

KEPT = 86_400.0  # Seconds for which a job is kept after its last change.

LOOK = 2.0  # Seconds between two looks for jobs that another process left.

ROOM = 30.0  # Seconds between two looks for room on a full disk.

TOGETHER = 16  # Motions that are generated as one batch and kept as one file.

# Seconds that motions of jobs may wait for others; interactive requests go first.
PATIENCE = 3600.0

Name = Annotated[str, InPath(pattern="^[0-9a-f]{32}$", description="Name of the job.")]


class Jobs:
    """The folder of jobs, and the work on them, one at a time.

    Args:
        service: The service, whose model generates the motions.
        folder: Folder of the jobs; None for one that is removed with the process.
    """

    def __init__(self, service: Service, folder: Path | None) -> None:
        self._service, self._own = service, folder is None
        self.folder = folder or Path(tempfile.mkdtemp(prefix="latentmotion-jobs-"))
        self.folder.mkdir(parents=True, exist_ok=True)
        self._new, self._turns = asyncio.Event(), Turns()

    def add(self, request: BatchRequest) -> JobState:
        """Returns a new job.

        Raises:
            Problem: There are too many.
            DiskFullError, OSError: It cannot be written.
        """
        client = CLIENT.get()
        jobs = Counter(_client(folder) for folder in self.folder.iterdir())
        if room(jobs, MOST, client) < 1:
            problem = f"{jobs.total()} jobs are here, {jobs[client]} of them yours"
            raise Problem(429, f"{problem}; delete some, or try later", 60.0)
        # 128 random bits, since who knows the name may read and delete the job.
        folder = self.folder / secrets.token_hex(16)
        try:
            folder.mkdir()
            (folder / "lock").touch()  # now, as there may be no room later
            if client:
                (folder / "client").write_text(client)
            write_file(folder / "request.json", request.model_dump_json())
        except (LatentMotionError, OSError):
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return JobState(id=folder.name, state="queued", motions=request.motions, finished=0)

    def wake(self) -> None:
        """Looks for new jobs at once."""
        self._new.set()

    def state(self, name: str) -> JobState:
        """Returns how far a job is.

        Raises:
            Problem: 404.
        """
        folder = self.folder / name
        motions = self._request(folder).motions
        if _answer(folder):
            return JobState(id=name, state="done", motions=motions, finished=motions)
        finished = min(motions, TOGETHER * len(_parts(folder)))
        state, error = "failed", None
        if (folder / "error").is_file():
            error = (folder / "error").read_text(encoding="utf-8")
        else:
            with _job_lock(folder) as free:
                state = "queued" if free else "running"
        return JobState(id=name, state=state, motions=motions, finished=finished, error=error)

    def answer(self, name: str) -> Path:
        """Returns the file of a job that is done.

        Raises:
            Problem: 404, there is no such job; 409, it is not done.
        """
        state = self.state(name)
        answer = _answer(self.folder / name)
        if answer is None:
            why = state.error or f"{state.finished} of {state.motions} motions are there"
            raise Problem(409, f"the job is {state.state}: {why}", 2.0)
        return answer

    def delete(self, name: str) -> None:
        """Ends a job and removes its files.

        Raises:
            Problem: 404.
        """
        self._request(self.folder / name)
        shutil.rmtree(self.folder / name, ignore_errors=True)

    async def work(self) -> None:
        """Works on jobs until it is cancelled, then removes its folder if that is temporary."""
        try:
            while True:
                self._new.clear()
                pause = await self._look()
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._new.wait(), pause)
        finally:
            if self._own:
                shutil.rmtree(self.folder, ignore_errors=True)

    async def _look(self) -> float:
        """Works on the open jobs; returns the seconds until the next look."""
        for job in self._turns.order(await asyncio.to_thread(self._open)):
            folder = job.folder
            self._turns.served([job])
            try:
                with suppress(FileNotFoundError), _job_lock(folder) as free:
                    if free:
                        await self._finish(folder)
            except (LatentMotionError, OSError) as error:
                if not is_disk_full(error):
                    raise
                print(f"error: job {folder.name} waits for room: {error}", file=sys.stderr)
                return ROOM
            if self._new.is_set():  # what is new may come before what was seen here
                return 0.0
        return LOOK

    def _open(self) -> list[_Open]:
        """Returns the unfinished jobs, the oldest first, and removes expired ones."""
        open_jobs = []
        for folder in self.folder.iterdir():
            with suppress(FileNotFoundError):
                changed = folder.stat().st_mtime
                if time.time() - changed > KEPT:
                    shutil.rmtree(folder, ignore_errors=True)
                elif (folder / "request.json").is_file() and not (
                    _answer(folder) or (folder / "error").is_file()
                ):
                    open_jobs.append((changed, folder))
        return [_Open(_client(folder), folder) for _, folder in sorted(open_jobs)]

    async def _finish(self, folder: Path) -> None:
        """Generates what a job lacks; it stays open while too many files of others wait.

        Raises:
            DiskFullError: There is no room for it; it stays as it is.
        """
        service = self._service
        try:
            request = self._request(folder)
            prompts, settings = request.all_prompts(), request.settings()
            for start in range(0, len(prompts), TOGETHER):
                part = folder / f"{start:05}.npz"
                # Made before a restart, or by another replica.
                if part.is_file():
                    continue
                some = prompts[start : start + TOGETHER]
                raw = await service.generated(settings, some, PATIENCE, background=True)
                raw = request.to_clean(raw)
                until = time.monotonic() + PATIENCE
                content, _ = await service.file(raw, "npz", request.clean, request.fps, until)
                write_file(part, content)
            names = [part.name for part in _parts(folder)]
            task = {"verb": "join", "folder": str(folder), "files": names}
            await service.written({**task, "format": request.format}, b"", PATIENCE)
        except Exception as error:
            if not folder.is_dir():  # deleted
                return
            if is_disk_full(error):
                raise
            # The job stays open, and the next look tries again.
            if isinstance(error, Problem) and error.status_code == HTTPStatus.TOO_MANY_REQUESTS:
                return
            problem = str(getattr(error, "detail", error)).replace(str(folder), folder.name)
            if not isinstance(error, LatentMotionError | Problem):
                print(f"error: job {folder.name}: {error!r}", file=sys.stderr)
                problem = "the service failed; its log says why"
            write_file(folder / "error", problem)

    def _request(self, folder: Path) -> BatchRequest:
        try:
            text = (folder / "request.json").read_text(encoding="utf-8")
            return BatchRequest.model_validate_json(text)
        except (OSError, ValidationError) as error:
            raise Problem(404, "there is no such job, or no more") from error


@dataclass(frozen=True)
class _Open:
    """A job that is not done."""

    client: str
    folder: Path


def _client(folder: Path) -> str:
    """Returns the client that added a job."""
    try:
        return (folder / "client").read_text()[:64]
    except (OSError, ValueError):
        return ""


def routes(service: Service, jobs: Jobs) -> APIRouter:
    """Returns the routes."""
    router = APIRouter(prefix="/v1/jobs", tags=["jobs"])
    missing: dict[int | str, dict[str, Any]] = {404: {"description": "There is no such job."}}

    @router.post("", status_code=202, response_model=JobState)
    async def add(body: BatchRequest) -> JSONResponse:
        """Have several motions made in the background."""
        service.check_ready()
        await run_in_threadpool(check, service.pipeline, body.settings(), body.all_prompts())
        job = await run_in_threadpool(jobs.add, body)
        jobs.wake()
        return JSONResponse(job.model_dump(), 202, {"Location": f"/v1/jobs/{job.id}"})

    @router.get("/{name}", responses=missing)
    def state(name: Name) -> JobState:
        """Tell how far a job is."""
        return jobs.state(name)

    @router.get(
        "/{name}/result",
        response_class=FileResponse,
        responses={**missing, 409: {"description": "It is not done; Retry-After says when."}},
    )
    def result(name: Name) -> FileResponse:
        """Download the result of a job."""
        answer = jobs.answer(name)
        form = answer.name.partition(".")[2]
        return FileResponse(answer, media_type=MEDIA_TYPES[form], filename=f"motion.{form}")

    @router.delete("/{name}", status_code=204, responses=missing)
    def delete(name: Name) -> Response:
        """End a job and remove its files."""
        jobs.delete(name)
        return Response(status_code=204)

    return router


@contextmanager
def _job_lock(folder: Path) -> Iterator[bool]:
    """Locks a job; yields whether no other process has it."""
    with (folder / "lock").open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
            return
        yield True


def _parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("[0-9]*.npz"))


def _answer(folder: Path) -> Path | None:
    return next((path for path in folder.glob("answer.*") if path.name[7:] in MEDIA_TYPES), None)
