"""What the checks of real clients share: the programs, the motions, the table they fill.

Skipped wherever the programs are not named:

    LATENTMOTION_BPY=…/bin/python               a Python that has bpy and usd-core
    LATENTMOTION_NODE_MODULES=…/node_modules    with gltf-validator, three and playwright-core
    LATENTMOTION_CLIENT_RESULTS=FOLDER          where table.md and the pictures go, if anywhere

    python -m pytest tests/clients
"""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path

import pytest

from latentmotion.motion import Motion

PROMPTS = (
    "a person walks forward and then kicks with the right leg",
    "a person jogs in a circle to the left",
    "a person lies down on the floor",
)
SECONDS = 4.0


@dataclass(frozen=True)
class Row:
    """One file in one client."""

    format: str
    client: str
    takes: str
    frames: int
    error: float
    scale: float
    up: str
    speed: float
    sole: float | None

    HEAD = (
        *("format", "client", "takes", "frames", "largest joint error, cm"),
        *("scale", "up", "speed", "soles, cm"),
    )

    def cells(self) -> list[str]:
        *start, frames, error, scale, up, speed, sole = astuple(self)
        numbers = [f"{frames}", f"{100 * error:.4f}", f"{scale:.4f}", up, f"{speed:.3f}"]
        return [*start, *numbers, "–" if sole is None else f"{100 * sole:+.1f}"]


class Table:
    """All that was measured in this run."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.notes: list[str] = []

    def lines(self) -> list[str]:
        head = [f"| {' | '.join(Row.HEAD)} |", "|" + "---|" * len(Row.HEAD)]
        rows = [f"| {' | '.join(row.cells())} |" for row in self.rows]
        return [*head, *rows, "", *(f"* {note}" for note in self.notes)]


TABLE = Table()


@pytest.fixture
def table() -> Table:
    return TABLE


@pytest.fixture(scope="session")
def blender() -> str:
    """The Python that has bpy and usd-core."""
    python = os.environ.get("LATENTMOTION_BPY", "")
    if not shutil.which(python):
        pytest.skip("set LATENTMOTION_BPY to a Python that has bpy and usd-core")
    os.environ.setdefault("LATENTMOTION_BLENDER", python)
    return python


@pytest.fixture(scope="session")
def node_modules() -> Path:
    folder = Path(os.environ.get("LATENTMOTION_NODE_MODULES", "none"))
    if not (folder.is_dir() and shutil.which("node")):
        pytest.skip("set LATENTMOTION_NODE_MODULES; needs Node.js")
    return folder


@pytest.fixture(scope="session")
def chromium() -> str:
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
    return found or pytest.skip("needs Chromium")


@pytest.fixture(scope="session")
def motions() -> list[Motion]:
    """What `latentmotion generate` makes of three prompts."""
    from latentmotion.pipeline import MotionPipeline

    made = MotionPipeline.from_pretrained("starter").batch(PROMPTS, SECONDS, range(len(PROMPTS)))
    with warnings.catch_warnings():
        # What clean-up thinks of a motion is no matter of formats.
        warnings.simplefilter("ignore")
        return [motion.cleaned() for motion in made]


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where pictures go; the table joins them at the end."""
    named = os.environ.get("LATENTMOTION_CLIENT_RESULTS")
    folder = Path(named) if named else tmp_path_factory.mktemp("clients")
    folder.mkdir(exist_ok=True)
    yield folder
    (folder / "table.md").write_text("\n".join(TABLE.lines()) + "\n")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if TABLE.rows:
        terminalreporter.section("formats in their clients")
        terminalreporter.write_line("\n".join(TABLE.lines()))
