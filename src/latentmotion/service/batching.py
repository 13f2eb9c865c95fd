"""Batching: waiting requests are generated in groups by worker threads; the queue is bounded.

A thread takes the oldest request and those of the same key behind it, as many as a batch may hold;
it never waits for more. Clients take turns, so that none can block the others: a client is a token,
where the service has several; without, all requests are one client's. Requests whose client has
gone or whose time is over are dropped before.

The model as the queue runs it: prompts with equal settings in one batch, all else one by one.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterable, Sequence
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Condition, Thread, get_native_id
from typing import Any, Protocol, TypeVar

from latentmotion.diffusion.condition import SentenceCondition
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.engine.encoder import MemoryCachedTextEncoder
from latentmotion.engine.request import GenerationRequest, frames_of
from latentmotion.errors import LatentMotionError
from latentmotion.pipeline import MotionPipeline, RawMotion
from latentmotion.service.metrics import Metrics
from latentmotion.service.problems import Problem

# Key and payloads of a batch to a result, or an exception, for each.
Run = Callable[[Hashable, Sequence[Any]], Sequence[Any]]

# Niceness of model threads and file workers: above the service's, so that its event loop is first.
# Only root may set a niceness below the one that a service was started with.
NICE = 5 + (os.getpriority(os.PRIO_PROCESS, 0) if sys.platform != "win32" else 0)


# Client whose request is being handled; empty where clients are not told apart.
CLIENT: ContextVar[str] = ContextVar("client", default="")


class Waiting(Protocol):
    """An item of a queue."""

    @property
    def client(self) -> str:
        """The client that it belongs to."""
        ...


W = TypeVar("W", bound=Waiting)


class Turns:
    """Clients take turns: first comes who was served the longest time ago."""

    def __init__(self) -> None:
        self._turn = 0
        self._served: dict[str, int] = {}

    def order(self, waiting: Iterable[W]) -> list[W]:
        """Returns what waits in the order of turns; each client's own stays in order."""
        before, ranked = Counter[str](), []
        for number, task in enumerate(waiting):
            rank = before[task.client], self._served.get(task.client, 0), number
            ranked.append((rank, task))
            before[task.client] += 1
        return [task for _, task in sorted(ranked, key=lambda pair: pair[0])]

    def served(self, tasks: Iterable[Waiting]) -> None:
        """Notes that tasks have had their turn."""
        for task in tasks:
            self._turn += 1
            self._served[task.client] = self._turn


def room(waiting: Counter[str], most: int, client: str) -> int:
    """Returns how many more items a client may queue.

    No client may have more than what is then left for the others (Choudhury and Hahne, Dynamic
    queue length thresholds, 1998), so that there is always some room for one that has nothing.

    Args:
        waiting: Number of waiting items by client.
        most: Most items that may wait.
        client: The client.
    """
    free = most - waiting.total()
    return (free - waiting[client] + 1) // 2 if client else free


@dataclass(eq=False)
class _Task:
    key: Hashable
    payload: Any
    future: asyncio.Future[Any]
    client: str = field(default_factory=CLIENT.get)
    since: float = field(default_factory=time.monotonic)


class Batcher:
    """A bounded queue in front of the model.

    Args:
        run: Computes the results of a batch.
        queue: Requests that wait at most.
        batch: Requests that are run together at most.
        metrics: Counters of sizes and times.
    """

    def __init__(self, run: Run, queue: int, batch: int, metrics: Metrics) -> None:
        self._run, self._queue, self._batch, self._metrics = run, queue, batch, metrics
        self._waiting: deque[_Task] = deque()
        self._background: deque[_Task] = deque()
        self._changed = Condition()
        self._ends = False
        # Seconds per motion until a batch was timed; then the mean of the last ten or so batches.
        self._seconds_each = 0.05
        self._threads: list[Thread] = []
        self._turns = Turns()

    def __len__(self) -> int:
        """Returns how many wait."""
        return len(self._waiting)

    def start(self, threads: int, nice: int = NICE) -> None:
        """Starts the threads, each of which runs a batch at a time.

        Args:
            threads: Number of threads.
            nice: Their niceness.
        """
        new = partial(Thread, target=self._work, args=[nice], daemon=True)
        self._threads = [new() for _ in range(threads)]
        for thread in self._threads:
            thread.start()

    async def submit(
        self,
        key: Hashable,
        payloads: Sequence[Any],
        seconds: float | None,
        background: bool = False,
    ) -> list[Any]:
        """Returns the results of payloads, which may be run together with others of the same key.

        Args:
            key: Equal for payloads that can be run together.
            payloads: One or more.
            seconds: Time until when they are wanted; None for any.
            background: Run them only where nothing else waits.

        Raises:
            Problem: 429, the queue is full; 503, the time is over; 422, they are too many.
            Exception: The exception of the first payload that failed.
        """
        loop = asyncio.get_running_loop()
        tasks = [_Task(key, payload, loop.create_future()) for payload in payloads]
        line = self._background if background else self._waiting
        with self._changed:
            if not background:
                if len(tasks) > (most := room(Counter(), self._queue, CLIENT.get())):
                    most = f"{len(tasks)} motions at once, and {most} may wait"
                    raise Problem(422, f"{most}; ask for fewer, or a job")
                self.check_room(len(tasks), seconds)
            line.extend(tasks)
            self._changed.notify(len(tasks))
        try:
            async with asyncio.timeout(seconds):
                return [await task.future for task in tasks]
        except TimeoutError:
            self._metrics.shed.labels("too late").inc()
            detail = f"not done within {seconds:g} s, as the service is busy; try again later"
            raise Problem(503, detail, self.wait()) from None
        finally:
            for task in tasks:
                if task.future.done() and not task.future.cancelled():
                    task.future.exception()  # it is told, for one of them
                else:
                    task.future.cancel()
                    with self._changed, suppress(ValueError):  # it has begun
                        line.remove(task)

    def wait(self) -> float:
        """Returns the seconds after which a request that waits now is expected to be done."""
        return self._seconds_to_make(len(self._waiting) + 1)

    def _seconds_to_make(self, motions: int) -> float:
        """Returns the seconds that motions take, which the threads share."""
        return self._seconds_each * motions / max(1, len(self._threads))

    def check_room(self, count: int = 1, seconds: float | None = None) -> None:
        """Raises Problem 429 if no more can wait, or what waits would be too late.

        Args:
            count: Payloads that come.
            seconds: Time until when they are wanted. Where a slow machine cannot make all that may
                wait in that time, all that wait would be too late otherwise, and none in time.
        """
        waiting, client = Counter(task.client for task in self._waiting), CLIENT.get()
        occupied, left = waiting.total(), room(waiting, self._queue, client)
        # Others have as many turns before it as it has itself, and its own batch has to be made.
        turns = waiting[client] + count if client else occupied
        before = sum(min(others, turns) for others in waiting.values())
        wait = self._seconds_to_make(before) + self._seconds_each * self._batch
        late = seconds is not None and wait > seconds
        if count > left or (occupied and late):
            self._metrics.shed.labels("queue full").inc()
            detail = f"{occupied} of {self._queue} places in the queue are taken; try again later"
            if count <= left:
                detail = f"{occupied} wait, and more would not be done in time; try again later"
            raise Problem(429, detail, self.wait())

    async def stop(self) -> None:
        """Ends the threads after their present batches."""
        with self._changed:
            self._ends = True
            self._changed.notify_all()
        await asyncio.to_thread(lambda: [thread.join() for thread in self._threads])

    def _work(self, nice: int) -> None:
        if sys.platform == "linux":  # elsewhere it would be the whole process
            os.setpriority(os.PRIO_PROCESS, get_native_id(), nice)
        while True:
            # The task whose turn it is, and others of its key; none at the end.
            batch: list[_Task] = []
            with self._changed:
                while not (batch or self._ends):
                    for line in (self._waiting, self._background):  # background tasks come last
                        waiting = [task for task in line if not task.future.cancelled()]
                        batch += self._turns.order(waiting)
                        batch = [task for task in batch if task.key == batch[0].key][: self._batch]
                        line.clear()
                        line.extend(task for task in waiting if task not in batch)
                    self._turns.served(batch)
                    if not batch:
                        self._changed.wait()
            if not batch:
                return
            began = time.monotonic()
            for task in batch:
                self._metrics.waited.observe(began - task.since)
            try:
                results = self._run(batch[0].key, [task.payload for task in batch])
            # The thread has to survive whatever a model raises; each waiting request gets the
            # error.
            except BaseException as error:
                results = [error] * len(batch)
            took = time.monotonic() - began
            self._metrics.batch_size.observe(len(batch))
            self._metrics.seconds.labels("model").observe(took)
            with self._changed:
                self._seconds_each += 0.1 * (took / len(batch) - self._seconds_each)
            with suppress(RuntimeError):  # the loop has ended
                batch[0].future.get_loop().call_soon_threadsafe(_deliver, batch, results)


def _deliver(batch: Sequence[_Task], results: Sequence[Any]) -> None:
    for task, result in zip(batch, results, strict=True):
        if task.future.done():
            continue
        if isinstance(result, BaseException):
            task.future.set_exception(result)
        else:
            task.future.set_result(result)


RECENT_PROMPTS = 1000  # Prompts whose embeddings stay in memory, some 20 kB each.


@dataclass(frozen=True)
class BatchSettings:
    """Settings that prompts share if they are generated in one batch."""

    steps: int | None  # Sampling steps; None for the model's own.
    guidance: float | None  # Guidance scale; None for the model's own.
    sampler: SamplerName | None  # Sampler; None for the model's own.
    predicted: bool  # The model predicts the length.


@dataclass(frozen=True)
class Prompt:
    """A motion to generate."""

    text: str  # What the person does.
    seconds: float | None  # Length; None for the predicted one.
    seed: int  # Seed of the noise.


def with_recent_prompts(pipeline: MotionPipeline) -> MotionPipeline:
    """Returns a pipeline that keeps the embeddings of the last prompts in memory."""
    condition = pipeline.condition
    if not isinstance(condition, SentenceCondition):
        return pipeline
    encoder = MemoryCachedTextEncoder(condition.encoder, RECENT_PROMPTS)
    return replace(pipeline, condition=replace(condition, encoder=encoder))


def first_prompt(pipeline: MotionPipeline) -> Prompt:
    """Returns a prompt for the first batch, which loads the networks before users wait for them."""
    condition = pipeline.card.condition
    prompt = (condition.labels or ["a person walks"])[0]
    return Prompt(prompt if condition.prompted else "", None, 0)


def check(pipeline: MotionPipeline, settings: BatchSettings, prompts: Sequence[Prompt]) -> None:
    """Checks prompts without running a network.

    Raises:
        InputError: One is not of the model's kind, or a number is out of range.
    """
    card, fps = pipeline.card, pipeline.representation.fps
    sampling = card.sampling.but(settings.steps, settings.guidance, settings.sampler)
    for prompt in prompts:
        frames = frames_of(card, prompt.seconds, 1, fps)
        GenerationRequest((prompt.text,), tuple(frames), (prompt.seed,), sampling).check(card, fps)


def run(
    pipeline: MotionPipeline, key: Hashable, payloads: Sequence[Any]
) -> list[Any | LatentMotionError]:
    """Returns the results of a batch.

    Args:
        pipeline: The model.
        key: `BatchSettings` for prompts; anything else for functions.
        payloads: Prompts, or functions without arguments.

    Returns:
        Raw motions, or what the functions return; or the error of each that could not be made.
    """
    if not isinstance(key, BatchSettings):
        return [_result_or_error(payload) for payload in payloads]
    sampling = key.steps, key.guidance, key.sampler

    def generated(prompts: Sequence[Prompt]) -> list[RawMotion]:
        seconds = None if key.predicted else [prompt.seconds or 0.0 for prompt in prompts]
        texts, seeds = [prompt.text for prompt in prompts], [prompt.seed for prompt in prompts]
        return pipeline.raw_motions(texts, seconds, seeds, *sampling)

    try:
        return generated(payloads)
    except LatentMotionError:
        # One of them is at fault, and the others do not pay for it.
        return [_result_or_error(lambda p=prompt: generated([p])[0]) for prompt in payloads]


def _result_or_error(function: Callable[[], Any]) -> Any | LatentMotionError:
    try:
        return function()
    except LatentMotionError as error:
        return error
