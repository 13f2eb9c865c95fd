"""A service without a model: a process that answers as the soak of `benchmarks/` expects."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn


@contextmanager
def served(*options: str) -> Iterator[tuple[str, int]]:
    """Yields the address and the process of a stub, like `benchmarks.generation.service`."""
    command = [sys.executable, "-m", __name__, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().strip(), process.pid
        finally:
            process.terminate()


async def app(scope: Any, receive: Any, send: Any) -> None:
    """Streams a piece, refuses GLB, makes jobs, and answers all else at once."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        await receive()
        await send({"type": "websocket.send", "text": json.dumps({"piece": 1, "prompt": ""})})
        await receive()  # the acknowledgment
        await send({"type": "websocket.close", "code": 1001, "reason": "going"})
        return
    content = b""
    while (message := await receive())["type"] == "http.request":
        content += message.get("body", b"")
        if not message.get("more_body"):
            break
    status = 202 if scope["path"] == "/v1/jobs" else 429 if b"glb" in content else 200
    headers = [(b"content-length", b"2")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": b"ok"})


def main() -> None:
    """Serves at any port, which is printed."""
    config = uvicorn.Config(
        app, port=0, lifespan="off", log_level="error", timeout_graceful_shutdown=1
    )
    place = config.bind_socket()
    print("http://{}:{}".format(*place.getsockname()), flush=True)
    uvicorn.Server(config).run([place])


if __name__ == "__main__":
    main()
