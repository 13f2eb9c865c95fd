"""Shared state of the routes: the model behind its queue, the workers, and readiness."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from functools import cache, partial
from typing import Any, TypeVar, get_args

from starlette.requests import Request

from latentmotion import formats
from latentmotion.cleanup import CleanUp
from latentmotion.control.scene import loop_or_timeline
from latentmotion.errors import LatentMotionError
from latentmotion.formats.content import encoded
from latentmotion.pipeline import MotionPipeline, RawMotion
from latentmotion.service import batching
from latentmotion.service.batching import NICE, Batcher
from latentmotion.service.metrics import Metrics
from latentmotion.service.problems import Problem
from latentmotion.service.schemas import Format, ModelAnswer, MotionRequest
from latentmotion.service.settings import Settings
from latentmotion.service.workers import FileWorkers, WorkerError, written

T = TypeVar("T")

STARTING, DRAINING = "the model is being loaded", "the service is shutting down"


class ClientGoneError(Exception):
    """The client closed its connection, so its request is dropped."""


class Service:
    """The parts of a running service.

    Args:
        settings: Settings of the service.

    Raises:
        ModelError: There is no such model.
    """

    def __init__(self, settings: Settings) -> None:
        # Before there are threads: OpenUSD waits for the interpreter while it holds the lock of the
        # system's loader; a library that another thread imports does it the other way round.
        lacks()
        pipeline = MotionPipeline.from_pretrained(settings.model, settings.runtime, threads=1)
        pipeline = pipeline.with_moves(*settings.moves)
        self.settings, self.metrics = settings, Metrics()
        self.pipeline = batching.with_recent_prompts(pipeline)
        self.batcher = Batcher(
            partial(batching.run, self.pipeline), settings.queue, settings.batch, self.metrics
        )
        self.slow = Batcher(partial(batching.run, self.pipeline), settings.queue, 1, self.metrics)
        self.metrics.watch_queue(lambda: len(self.batcher) + len(self.slow))
        workers = settings.file_workers
        # Our own motions get a second try; a file from outside that ends a process gets none.
        self.writers = FileWorkers(workers, settings.queue, self.metrics, tries=2)
        self.readers = FileWorkers(workers, 2 * workers, self.metrics)
        self.obstacle: str | None = STARTING
        self.draining = asyncio.Event()
        self.leaving = False

    async def start(self) -> None:
        """Starts the threads and makes a first motion, so that the networks are loaded."""
        self.batcher.start(self.settings.threads)
        self.slow.start(1, 2 * NICE)
        first = batching.first_prompt(self.pipeline)
        try:
            # Ten minutes: nobody waits for it, and a cold disk may need some of them.
            await self.generated(batching.BatchSettings(None, None, None, True), [first], 600.0)
        except Exception as error:
            self.obstacle = "the model could not be loaded; the log of the service says why"
            print(f"error: the model could not be loaded: {error}", file=sys.stderr)
            return
        if not self.leaving:
            self.obstacle = None
            self.metrics.ready.set(1)
        if self.settings.start_workers:
            await self.writers.start()
            await self.readers.start()

    async def watch(self) -> None:
        """Measures how late the event loop is."""
        while True:
            # Five times a second: often enough to see a blocked loop, too rare to cost anything.
            due = time.monotonic() + 0.2
            await asyncio.sleep(0.2)
            self.metrics.late.observe(time.monotonic() - due)

    def leave(self) -> None:
        """Says that the service is not ready, so that a balancer sends no more work."""
        self.leaving = True
        self.metrics.ready.set(0)

    def drain(self) -> None:
        """Takes no new work from now on; what waits is finished."""
        self.leave()
        self.obstacle = DRAINING
        self.draining.set()

    async def stop(self) -> None:
        """Ends threads and processes."""
        self.drain()
        await self.batcher.stop()
        await self.slow.stop()
        await self.writers.stop()
        await self.readers.stop()

    def check_ready(self) -> None:
        """Raises Problem 503 while no work is taken."""
        if self.obstacle is not None:
            raise Problem(503, f"{self.obstacle}; try again", 2.0)

    async def generated(
        self,
        settings: batching.BatchSettings,
        prompts: Sequence[batching.Prompt],
        seconds: float,
        background: bool = False,
    ) -> list[RawMotion]:
        """Returns the motions of prompts, not cleaned up.

        Raises:
            LatentMotionError: A prompt cannot be used.
            Problem: The queue is full, or the time is over.
        """
        # In a thread: 256 long prompts would hold up the event loop.
        await asyncio.to_thread(batching.check, self.pipeline, settings, prompts)
        return await self.batcher.submit(settings, prompts, seconds, background)

    async def called(self, function: Callable[[], T], seconds: float | None) -> T:
        """Returns what a function of the model returns that may take seconds, as a timeline does.

        It has a queue and a thread of its own, which yields to the others, so that no short request
        waits for it.

        Args:
            function: Runs the model.
            seconds: Time until when it is wanted; None for any.

        Raises:
            Problem: The queue is full, or the time is over.
        """
        # A key that equals no other: such work is never batched.
        return (await self.slow.submit(object(), [function], seconds))[0]

    def deadline(self) -> float:
        """Returns the deadline of a request that arrives now, on the clock of `time.monotonic`."""
        return time.monotonic() + self.settings.deadline

    def place(self, form: str, clean: bool, fps: float | None) -> AbstractContextManager[None]:
        """Counts a file that will be written, if motions need one.

        Raises:
            Problem: 429, it would not be done in time, so that its motion need not be generated.
        """
        if _plain(form, clean, fps):
            return nullcontext()
        return self.writers.place(self.settings.deadline)

    async def motion(self, request: MotionRequest, until: float) -> tuple[RawMotion, bool]:
        """Returns the motion of a request, and whether it still has to be cleaned up.

        Args:
            request: The request.
            until: Deadline of the request.

        Raises:
            LatentMotionError: The request cannot be met.
            Problem: The queue is full, or the time is over.
        """
        pipeline, seconds = self.pipeline, until - time.monotonic()
        scene, sampled = request.scene(), (request.steps, request.guidance)
        settings, goals = request.settings(), scene.all_goals()
        if scene.loop or scene.timeline:
            if request.sampler:
                raise Problem(422, "loops and timelines have a sampler of their own; leave it out")
            make = partial(loop_or_timeline, pipeline, scene, request.seed, *sampled)
        elif goals:
            batching.check(pipeline, settings, request.prompts())
            about = request.prompt, request.seconds, request.seed, *sampled, request.sampler
            # Joints are put at their goals after clean-up, which a worker could not do.
            steps = CleanUp() if request.clean else None
            make = partial(pipeline, *about, goals, takes=1, clean_up=steps)
        else:
            motions = await self.generated(settings, request.prompts(), seconds)
            return request.to_clean(motions)[0], request.clean
        return RawMotion(await self.called(make, seconds)), request.clean and not goals

    async def file(
        self, raw: Sequence[RawMotion], form: str, clean: bool, fps: float | None, until: float
    ) -> tuple[bytes, str]:
        """Returns motions as bytes, and their format.

        Args:
            raw: The motions.
            form: The format.
            clean: Whether they are cleaned up.
            fps: Frames per second; None as they are.
            until: Deadline of the request.

        Raises:
            Problem: As for `written`.
        """
        if _plain(form, clean, fps):
            return encoded([item.motion for item in raw], form)
        return await self.written(*written(raw, form, clean, fps), until - time.monotonic())

    async def written(
        self, task: dict[str, Any], content: bytes, seconds: float
    ) -> tuple[bytes, str]:
        """Returns what a worker that writes files makes of a task, and its format.

        Raises:
            Problem: Too many wait, it took too long, or its process was killed, and the next, too.
        """
        with self.metrics.seconds.labels("file").time():
            try:
                head, file = await self.writers.run(task, content, seconds)
            except WorkerError as error:
                raise Problem(503, f"the file was not written ({error}); try again", 1.0) from error
        return file, head["format"]

    async def read(self, task: dict[str, Any]) -> dict[str, Any]:
        """Processes an uploaded file in a worker; returns the worker's description of the result.

        Raises:
            InputError: The file cannot be used.
            Problem: Too many wait, or it took too long.
        """
        seconds = self.settings.deadline
        try:
            with self.metrics.seconds.labels("upload").time():
                head, _ = await self.readers.run(task, b"", seconds)
        except WorkerError as error:
            raise Problem(
                422,
                f"the file could not be worked on ({error}): it is damaged, or too large; "
                "send a smaller one",
            ) from error
        return head


def _plain(form: str, clean: bool, fps: float | None) -> bool:
    """Returns whether joints are given as the model makes them."""
    return form == "raw" and not clean and fps is None


@cache
def lacks() -> dict[str, str]:
    """Returns the formats that cannot be written here, and what each needs."""
    lacking = {}
    for form in set(get_args(Format)) - {"json", "raw", "viewer"}:
        try:
            formats.check_ending(f"motion.{form}")
        except LatentMotionError as error:
            lacking[form] = str(error)
    return lacking


def about(pipeline: MotionPipeline) -> ModelAnswer:
    """Returns the description of a model for clients."""
    lacking = lacks()
    card, space = pipeline.card, pipeline.representation
    condition, (shortest, longest) = card.condition, card.frames
    labels = list(condition.labels)
    return ModelAnswer(
        name=card.name,
        license=card.provenance.license,
        prompts="labels" if labels else "sentences" if condition.prompted else "nothing",
        labels=labels,
        seconds=(shortest / space.fps, longest / space.fps),
        fps=space.fps,
        joints=list(space.skeleton.names),
        parents=list(space.skeleton.parents),
        formats=[form for form in get_args(Format) if form not in lacking],
        lacking=dict(sorted(lacking.items())),
        sampling=asdict(card.sampling),
        directed=pipeline.backend.pullback is not None,
    )


async def unless_gone(request: Request, work: Awaitable[T]) -> T:
    """Returns the result of some work, which is cancelled if the client disconnects.

    Raises:
        ClientGoneError: It went.
    """

    async def disconnection() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    task, disconnected = asyncio.ensure_future(work), asyncio.ensure_future(disconnection())
    try:
        await asyncio.wait({task, disconnected}, return_when=asyncio.FIRST_COMPLETED)
        if not task.done():
            raise ClientGoneError
        return task.result()
    finally:
        disconnected.cancel()
        task.cancel()
