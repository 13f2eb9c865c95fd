"""Settings of the service, checked before anything is loaded; tokens are kept as hashes."""

from __future__ import annotations

import hashlib
import hmac
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from latentmotion.engine.session import Runtime
from latentmotion.errors import InputError
from latentmotion.model.card import DEFAULT
from latentmotion.storage.files import read_lines

LOOPBACK = ("localhost", "127.0.0.1", "::1")  # Names of this machine that no other machine reaches.

LEAST_TOKEN = 16  # Characters of a token at least: fewer can be guessed.

CONNECTIONS = 1000  # Requests under way at the same time; beyond, they are answered by 503.

# Most connections of one address, so that a single client cannot take all of them.
CONNECTIONS_OF_ADDRESS = CONNECTIONS // 2

Middleware = Callable[[Any], Any]  # Takes an ASGI application and returns one, as tracing does.


@dataclass(frozen=True, kw_only=True)
class ServiceOptions:
    """Settings that the command line has as options of the same name."""

    model: str = DEFAULT  # Name or folder of an exported model.
    threads: int = 1  # Threads that run the model, each a batch of its own.
    queue: int = 64  # Motions that wait at most; beyond, requests are refused (429).
    deadline: float = 30.0  # Seconds that a request may take.
    # Processes that clean up motions and write files; as many again read uploads.
    file_workers: int = 2
    upload: int = 64  # Megabytes of an uploaded file at most.
    streams: int = 32  # Streams that are open at the same time at most.
    jobs: Path | None = None  # Folder of jobs, kept when the service stops; replicas may share it.


@dataclass(frozen=True, kw_only=True)
class Settings(ServiceOptions):
    """Settings of the service.

    Raises:
        InputError: A number is out of range.
    """

    # Folders of clips that motions may start from, besides those that ship.
    moves: tuple[Path, ...] = ()
    runtime: Runtime = "auto"  # Engine of the networks.
    batch: int = 16  # Motions that are generated together at most.
    # Start file workers once the model is loaded, so that no first file waits for them.
    start_workers: bool = False
    # SHA-256 of each accepted token; without any, no token is needed.
    tokens: tuple[bytes, ...] = ()
    hosts: tuple[str, ...] = LOOPBACK  # Names by which clients may call the service; empty for any.
    # Origins of pages on other hosts that may call, such as `https://example.com`.
    origins: tuple[str, ...] = ()
    # ASGI middleware around everything, the first outermost.
    middleware: tuple[Middleware, ...] = ()

    def __post_init__(self) -> None:
        counts = {"threads": 64, "queue": 100_000, "batch": 256, "file_workers": 64}
        for name, most in {**counts, "streams": 10_000, "upload": 4096}.items():
            if not 1 <= getattr(self, name) <= most:
                label = name.replace("_", " ")
                raise InputError(f"{label} {getattr(self, name)}: expected 1 to {most:,}")
        if not 0.1 <= self.deadline <= 3600:
            raise InputError(f"deadline {self.deadline:g}: expected 0.1 to 3600 seconds")
        for origin in self.origins:
            if not re.fullmatch(r"https?://[^/\s*]+", origin):
                raise InputError(f"origin {origin}: expected one such as https://example.com:8080")

    def knows(self, token: str) -> bool:
        """Returns whether a token is accepted, in a time that does not depend on the tokens."""
        digest = hashlib.sha256(token.encode("utf-8", "replace")).digest()
        equal = [hmac.compare_digest(digest, expected) for expected in self.tokens]
        return any(equal)


def read_tokens(path: Path) -> tuple[bytes, ...]:
    """Reads tokens, one per line: as they are, or `sha256:` and 64 hexadecimal digits.

    Raises:
        InputError: The file cannot be read, or a token is too short or has other characters.
    """
    digests = []
    for number, line in enumerate(read_lines(path, "token"), 1):
        if line.startswith("sha256:"):
            if not re.fullmatch(r"sha256:[0-9a-fA-F]{64}", line):
                raise InputError(f"{path}, token {number}: expected sha256: and 64 hex digits")
            digests.append(bytes.fromhex(line.removeprefix("sha256:")))
            continue
        if not re.fullmatch(rf"[\w.~+/=-]{{{LEAST_TOKEN},}}", line, re.ASCII):
            raise InputError(
                f"{path}, token {number}: expected {LEAST_TOKEN} or more of the letters, digits "
                "and - . _ ~ + / =, e.g. from: openssl rand -hex 32"
            )
        digests.append(hashlib.sha256(line.encode()).digest())
    return tuple(digests)


def check_bind(host: str, settings: Settings, insecure: bool) -> None:
    """Refuses to let other machines in without a token.

    Raises:
        InputError: The host is not this machine alone, there are no tokens, and `insecure` is not
            set.
    """
    if host not in LOOPBACK and not settings.tokens and not insecure:
        raise InputError(
            f"--host {host} lets other machines in, and there is no --token-file; write one "
            "(a token per line), or pass --insecure where something before the service checks "
            "who calls"
        )
