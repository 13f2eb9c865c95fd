"""`latentmotion mcp` and `mmcp`: the model for agents and for animation programs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.cli import options
from latentmotion.errors import InputError, MissingExtraError
from latentmotion.model.card import DEFAULT
from latentmotion.pipeline import MotionPipeline


@dataclass(frozen=True)
class Mcp:
    """Serve an agent over MCP: generate, direct, describe, search, retarget, render.

    Without --port the agent's program starts this command and speaks to it over standard input
    and output: claude mcp add motion -- latentmotion mcp --folder motions
    """

    folder: Path = Path()
    """The only folder whose files the agent's tools read and write."""
    port: int | None = None
    """Port to listen at on this machine, over HTTP at /mcp."""
    model: str = DEFAULT
    """Name or folder of an exported model."""
    threads: options.Threads = None

    def run(self) -> None:
        """Serves until the agent's program goes, or Ctrl+C.

        Raises:
            InputError: There is no such folder.
            MissingExtraError: The package `mcp` is not installed.
        """
        if not self.folder.is_dir():
            raise InputError(f"there is no folder {self.folder}; make it first")
        try:
            from latentmotion.protocols.mcp import server
        except ModuleNotFoundError as error:
            raise _missing("mcp", error) from error
        ready = server(
            MotionPipeline.from_pretrained(self.model, threads=self.threads), self.folder
        )
        if self.port is None:
            ready.run("stdio")
        else:
            print(f"http://127.0.0.1:{self.port}/mcp", flush=True)
            ready.run("streamable-http", host="127.0.0.1", port=self.port)


@dataclass(frozen=True)
class Mmcp:
    """Serve animation programs over MMCP, such as Proscenium for Blender.

    Example: latentmotion mmcp, then http://localhost:8000 as the server in the add-on
    """

    port: int = 8000
    """Port to listen at on this machine."""
    model: str = DEFAULT
    """Name or folder of an exported model."""
    threads: options.Threads = None

    def run(self) -> None:
        """Serves until Ctrl+C.

        Raises:
            MissingExtraError: The package `motionmcp-sdk` is not installed.
        """
        try:
            import uvicorn

            from latentmotion.protocols.mmcp import application
        except ModuleNotFoundError as error:
            raise _missing("mmcp", error) from error
        app = application(MotionPipeline.from_pretrained(self.model, threads=self.threads))
        print(f"http://localhost:{self.port}", flush=True)
        uvicorn.run(app, host="127.0.0.1", port=self.port, log_level="warning")


def _missing(extra: str, error: ModuleNotFoundError) -> Exception:
    if error.name is None or error.name.startswith("latentmotion"):
        return error
    return MissingExtraError(f"latentmotion {extra}", error.name, extra)
