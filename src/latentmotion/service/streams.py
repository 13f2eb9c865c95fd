"""Streams: endless motion over a WebSocket, in constant memory, no faster than the client takes it.

client  {"prompt": "a person walks", "seed": 7}     begins
server  {"joints": […], "parents": […], "offsets": […], "fps": 20}  once
server  {"piece": 1, "prompt": …, "frames": 40}     then float32: frames × joints × 3, meters
client  {"ack": 1}                                  one piece more may be sent
client  {"prompt": "a person dances"}               at any time
server  {"error": "…"}                              a message that could not be used
"""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from functools import partial

import numpy as np
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import ValidationError

from latentmotion.control.stream import CALL, STRIDE, MotionStream, generate_stream
from latentmotion.errors import InputError, LatentMotionError
from latentmotion.service.batching import BatchSettings, Prompt, check
from latentmotion.service.problems import Problem, refuse_stream
from latentmotion.service.schemas import StreamMessage
from latentmotion.service.state import Service

AHEAD = 2  # Pieces that are sent before the client acknowledges earlier ones, at most.

IDLE = 60.0  # Seconds for which a stream waits for its client: a prompt, or what it acknowledges.

# WebSocket close codes (RFC 6455) for a broken rule and for a server that shuts down.
POLICY, GOING = 1008, 1001


class ClientStream:
    """One client's stream.

    Args:
        service: The service, whose model generates the motion.
        socket: The client.
    """

    def __init__(self, service: Service, socket: WebSocket) -> None:
        self._service, self._socket = service, socket
        self._sent = self._acknowledged = 0
        self._said = asyncio.Event()
        self._motion: MotionStream | None = None

    async def run(self) -> None:
        """Serves the client until it disconnects, is idle for long, or the service stops."""
        socket, service = self._socket, self._service
        await socket.accept()
        parts = [self._listen(), self._send(), service.draining.wait()]
        tasks = [asyncio.ensure_future(part) for part in parts]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            code, reason = GOING, "the service is shutting down; connect again"
            for task in tasks[:2]:
                if task.done():
                    code, reason = task.result() or (GOING, "")
            with suppress(RuntimeError, WebSocketDisconnect):
                await socket.close(code, reason[:120])
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _listen(self) -> tuple[int, str]:
        """Reads the client's messages; returns the code and reason to close with."""
        pipeline = self._service.pipeline
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return GOING, "the client has gone"
            try:
                said = StreamMessage.model_validate_json(message.get("text") or "")
                if said.prompt is not None:
                    seconds = STRIDE * CALL / pipeline.representation.fps
                    settings = BatchSettings(said.steps, said.guidance, None, False)
                    check(pipeline, settings, [Prompt(said.prompt, seconds, said.seed)])
                if self._motion is not None and said.prompt is not None:
                    self._motion.say(said.prompt)
                elif said.prompt is not None:
                    arguments = said.prompt, said.seed, said.steps, said.guidance
                    self._motion = generate_stream(pipeline, *arguments)
                elif self._motion is None:
                    raise InputError("the first message needs a prompt")
                if said.ack is not None:
                    self._acknowledged = max(self._acknowledged, min(said.ack, self._sent))
                self._said.set()
            except ValidationError as error:
                first = error.errors(include_url=False, include_input=False)[0]
                location = ".".join(map(str, first["loc"])) or "message"
                problem = f"{location}: {first['msg']}"
            except LatentMotionError as error:
                problem = str(error)
            else:
                continue
            if self._motion is None:
                return POLICY, problem
            await self._send_json({"error": problem[:500]})

    async def _send(self) -> tuple[int, str]:
        """Sends pieces, a few ahead of what the client has acknowledged."""
        silent = POLICY, f"nothing was said for {IDLE:g} s"
        while self._motion is None:
            if not await self._heard():
                return silent
        skeleton = self._motion.space.skeleton
        header = {"joints": skeleton.names, "parents": skeleton.parents}
        header["offsets"] = np.asarray(skeleton.offsets).tolist()
        await self._send_json({**header, "fps": self._motion.space.fps})
        while True:
            while self._sent - self._acknowledged >= AHEAD:
                if not await self._heard():
                    return silent
            try:
                # Without a deadline: a piece that is given up while it is made would be missing.
                piece = partial(next, self._motion)
                (motion,) = await self._service.batcher.submit(object(), [piece], None)
            except Problem:  # the queue is full: the stream waits as anyone does
                await asyncio.sleep(0.5)
                continue
            except LatentMotionError as error:
                return POLICY, str(error)
            self._sent += 1
            header = {"piece": self._sent, "prompt": motion.caption, "frames": len(motion)}
            await self._send_json(header)
            await asyncio.wait_for(
                self._socket.send_bytes(motion.joints.astype("<f4").tobytes()), IDLE
            )

    async def _heard(self) -> bool:
        """Waits until the client says something; returns whether that was so in time."""
        self._said.clear()
        with suppress(TimeoutError):
            return await asyncio.wait_for(self._said.wait(), IDLE)
        return False

    async def _send_json(self, message: object) -> None:
        await asyncio.wait_for(self._socket.send_text(json.dumps(message)), IDLE)


def routes(service: Service) -> APIRouter:
    """Returns the route."""
    router = APIRouter(prefix="/v1")
    open_streams = 0

    @router.websocket("/stream")
    async def stream(socket: WebSocket) -> None:
        """Stream endless motion."""
        nonlocal open_streams
        if service.obstacle is not None or open_streams >= service.settings.streams:
            reason = service.obstacle or f"{open_streams} streams are open"
            problem = Problem(503, f"{reason}; try again later", 5.0)
            await refuse_stream(problem, socket.scope, socket.receive, socket.send)
            return
        open_streams += 1
        service.metrics.streams.set(open_streams)
        try:
            await ClientStream(service, socket).run()
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            pass  # the client does not read, or has gone
        finally:
            open_streams -= 1
            service.metrics.streams.set(open_streams)

    return router
