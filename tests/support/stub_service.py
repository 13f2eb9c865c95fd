"""A service without a model: a process that answers as the soak of `benchmarks/` expects."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

import uvicorn


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
    """Serves at a port; other options of the service mean nothing here."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--port", type=int, required=True)
    options, _ = parser.parse_known_args()
    uvicorn.run(
        app,
        port=options.port,
        lifespan="off",
        log_level="critical",
        timeout_graceful_shutdown=1,
    )


# Starts it, as `benchmarks.harness.replicas` starts the service.
COMMAND = (sys.executable, "-m", "tests.support.stub_service")

if __name__ == "__main__":
    main()
