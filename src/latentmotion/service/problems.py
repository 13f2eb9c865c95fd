"""Answers to requests that cannot be met: problem+json (RFC 9457) with our error texts.

400 no HTTP or JSON   401 token   403 host, origin   404, 405   408 slow body   413 size
422 what is asked for cannot be made   429 queue full   503 not ready, shutting down, too late
507 disk full
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from http.client import responses
from typing import Any

from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from latentmotion.errors import LatentMotionError
from latentmotion.storage.files import is_disk_full

MEDIA_TYPE = "application/problem+json"

FULL_DISK = "the disk of the service is full; delete jobs that are done, or try again later"


class Problem(HTTPException):
    """A request that cannot be met.

    Args:
        status: Status of HTTP.
        detail: What was found, what was expected and what to do.
        retry_after: Seconds after which to try again.
    """

    def __init__(self, status: int, detail: str, retry_after: float | None = None) -> None:
        headers = {} if retry_after is None else {"Retry-After": str(max(1, round(retry_after)))}
        super().__init__(status, detail, headers)


def problem_response(
    status: int,
    detail: str,
    headers: Mapping[str, str] | None = None,
    errors: Sequence[Mapping[str, str]] = (),
) -> Response:
    """Returns the answer.

    Args:
        status: Status of HTTP.
        detail: What was found, what was expected and what to do.
        headers: Headers of its own.
        errors: `at` and `problem` of each field that cannot be used.
    """
    head: dict[str, Any] = {
        "type": "about:blank",
        "title": responses.get(status, "Problem"),
        "status": status,
    }
    content = head | {"detail": detail} | ({"errors": list(errors)} if errors else {})
    # Text from a request may hold halves of characters, which UTF-8 cannot.
    body = json.dumps(content, ensure_ascii=True).encode()
    return Response(body, status, dict(headers or {}), MEDIA_TYPE)


async def refuse_stream(problem: Problem, scope: Scope, receive: Receive, send: Send) -> None:
    """Answers a WebSocket that was not accepted; servers without this extension say 403."""
    if "websocket.http.response" in scope.get("extensions", {}):
        answer = problem_response(problem.status_code, str(problem.detail), problem.headers)
        await answer(scope, receive, send)
    else:
        await send({"type": "websocket.close", "code": 1008, "reason": problem.detail[:120]})


async def on_error(request: Request, error: Exception) -> Response:
    """Answers errors of HTTP, our own, and a full disk."""
    if isinstance(error, HTTPException):
        return problem_response(error.status_code, str(error.detail), error.headers)
    if is_disk_full(error):
        print(f"error: {error}", file=sys.stderr)
        return problem_response(507, FULL_DISK, {"Retry-After": "60"})
    if isinstance(error, LatentMotionError):
        return problem_response(422, str(error))
    raise error  # every other error of the system is the service's own


async def on_fields(request: Request, error: Exception) -> Response:
    """Answers fields that are missing, unknown or out of range."""
    assert isinstance(error, RequestValidationError)
    problems = []
    for entry in error.errors()[:20]:
        if entry["type"] == "json_invalid":
            return problem_response(400, f"the body is not JSON, at character {entry['loc'][-1]}")
        location = ".".join(str(part) for part in entry["loc"])
        message = str(entry["msg"]).removeprefix("Value error, ")[:500]
        if entry["loc"] == ("body",) and entry["type"] != "value_error":
            message = _NO_OBJECT
        if entry["type"] == "extra_forbidden":
            field = str(entry["loc"][-1])
            schemas = request.app.openapi()["components"]["schemas"].values()
            fields = {name for schema in schemas for name in schema.get("properties", ())}
            near = get_close_matches(field, fields, n=1)
            message = (
                f"unknown field; did you mean {near[0]!r}?" if near else "unknown field; see /docs"
            )
        problems.append({"at": location[:200], "problem": message})
    detail = "; ".join(f"{entry['at']}: {entry['problem']}" for entry in problems[:3])
    more = f"; and {len(problems) - 3} more" if len(problems) > 3 else ""
    return problem_response(422, detail + more, errors=problems)


async def on_failure(request: Request, error: Exception) -> Response:
    """Answers errors of the service itself; the server's log has the traceback."""
    # The server closes the connection after an error; who is told opens another.
    return problem_response(500, "the service failed; its log says why", {"Connection": "close"})


_NO_OBJECT = "expected a JSON object, sent with Content-Type: application/json"
