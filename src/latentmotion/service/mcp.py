"""MCP: the pipeline as tools for agents (Model Context Protocol, the package `mcp`).

Tools read and write motion files of one folder and answer with what a motion shows, in numbers and
as a strip of frames that the agent can look at.
"""

from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

from mcp.server.mcpserver import Image, MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from latentmotion import __version__
from latentmotion.control.scene import FORMAT, SCHEMA_FILE, Scene, checked, loop_or_timeline
from latentmotion.errors import InputError, LatentMotionError
from latentmotion.formats import ENDINGS, READABLE, load, save
from latentmotion.kinematics.humanoid import to_humanml3d
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.measure.facts import FPS
from latentmotion.measure.reported_acts import acts_of
from latentmotion.measure.scene import describe as measured
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.ranking.scorer import Scorer
from latentmotion.ranking.search import MotionIndex
from latentmotion.render import strip
from latentmotion.retarget import read_rig, transfer
from latentmotion.storage.configuration import from_json
from latentmotion.storage.reading import parse_json

_EXAMPLE = (
    '{"prompt": "a person walks", "seconds": 4, "seed": 7, "path": {"points": [[0, 0], [1, 3]]}, '
    '"goals": [{"joint": "right_wrist", "at": 3, "to": [0.3, 1.4, 2.1]}], "headings": [{"at": '
    '3.9, "degrees": 90}]}, or {"timeline": [{"prompt": "a person walks", "seconds": 3}, '
    '{"prompt": "a person sits down"}]}'
)

File = Annotated[str, Field(description=f"Motion file of the folder: {' '.join(READABLE)}")]
NewFile = Annotated[
    str,
    Field(
        description=f"File to write in the folder; its ending is its format: {' '.join(ENDINGS)}"
    ),
]


class Tools:
    """The tools; each is a method whose docstring the agent reads."""

    def __init__(self, pipeline: MotionPipeline, folder: Path) -> None:
        self.pipeline, self.folder = pipeline, folder.resolve()

    def generate(
        self, prompt: str, file: NewFile, seconds: float | None = None, seed: int = 0
    ) -> list[Any]:
        """Generate human motion from an English sentence ("a person walks and sits down")."""
        return self._written(file, self.pipeline(prompt, seconds, seed))

    def direct(
        self,
        scene: Annotated[dict[str, Any], Field(description=f"Such as {_EXAMPLE}")],
        file: NewFile,
    ) -> list[Any]:
        """Generate motion with a path, goals of joints and headings, or of several prompts.

        Meters, y up; the person starts above the origin facing +z, and +x is on the left. The
        resource latentmotion://scene.schema.json describes all keys.
        """
        values = parse_json(json.dumps({"format": FORMAT, **scene}), "scene")  # finite numbers
        read = checked(from_json(Scene, values), "scene")
        seed = read.seed or 0
        if read.loop or read.timeline:
            motion = loop_or_timeline(self.pipeline, read, seed).cleaned()
        else:
            goals = read.all_goals(self.folder)
            motion = self.pipeline(read.prompt, read.seconds, seed, goals=goals)
        return self._written(file, motion)

    def describe(self, file: File) -> list[Any]:
        """Measure what a motion shows: acts in order with times, path, turns, lowest point."""
        return [json.dumps([facts(motion) for motion in self._read(file)])]

    def search(
        self, sentence: str, count: Annotated[int, Field(ge=1, le=50)] = 5
    ) -> list[dict[str, Any]]:
        """Find parts of the folder's motion files that show what a sentence says."""
        hits = MotionIndex.of(self.folder, Scorer.load(None), None).search(sentence, count)
        return [
            {
                "file": hit.window.path.resolve().relative_to(self.folder).as_posix(),
                "start": hit.window.start,
                "end": hit.window.end,
                "score": round(hit.score, 3),
            }
            for hit in hits
        ]

    def retarget(self, file: File, character: str, output: NewFile) -> str:
        """Put a motion on a character (.glb, .gltf, .vrm, .fbx or .bvh) of the folder."""
        paths = transfer.write(
            self._path(output), read_rig(self._path(character)), self._read(file)
        )
        return f"wrote {', '.join(path.name for path in paths)}"

    def render(self, file: File, figures: Annotated[int, Field(ge=1, le=24)] = 9) -> Image:
        """Draw a motion file as a strip of figures, earliest on the left."""
        return picture(self._read(file), figures)

    def _written(self, file: str, motion: Motion) -> list[Any]:
        paths = save(self._path(file), [motion])
        about = {
            "wrote": [path.relative_to(self.folder).as_posix() for path in paths],
            "seconds": round(motion.seconds, 2),
            **{key: motion.metadata[key] for key in ("notes", "goals") if key in motion.metadata},
            "shows": facts(motion),
        }
        return [json.dumps(about, default=str), picture([motion])]

    def _read(self, file: str) -> list[Motion]:
        return load(self._path(file))

    def _path(self, name: str) -> Path:
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.folder):
            raise InputError(f"{name} is outside of {self.folder}; name a file in that folder")
        return path


def facts(motion: Motion) -> dict[str, Any]:
    """Returns what a motion shows, as JSON can hold it."""
    motion = motion.resampled(FPS)
    ours = motion.skeleton.names == HUMANML3D.names
    shown = measured(motion.joints if ours else to_humanml3d(motion.animation()))
    acts = [
        {
            "act": event.kind,
            "from": event.start / FPS,
            "to": event.end / FPS,
            **{key: getattr(event, key) for key in ("side", "direction") if getattr(event, key)},
            **({"count": event.count} if event.count > 1 else {}),
            **({"degrees": round(event.amount)} if event.kind == "turn" else {}),
        }
        for event in (act.event for act in acts_of(shown))
    ]
    path = shown.path
    return {
        "acts": acts,
        "meters_walked": round(path.length, 2),
        "meters_forward": round(path.forward, 2),
        "meters_left": round(path.left, 2),
        "degrees_turned_left": round(path.turned),
        "postures": list(dict.fromkeys(event.kind for event in shown.postures)),
    }


def picture(motions: Sequence[Motion], figures: int = 9) -> Image:
    """Returns a strip of frames as an image."""
    with tempfile.TemporaryDirectory() as folder:
        (file,) = strip.write(Path(folder, "strip.png"), motions, figures=figures, width=900)
        return Image(data=file.read_bytes(), format="png")


def server(pipeline: MotionPipeline, folder: Path) -> MCPServer:
    """Returns the server of a model.

    Args:
        pipeline: The model.
        folder: The only folder whose files are read and written.
    """
    tools = Tools(pipeline, folder)
    tool_server = MCPServer(
        "latentmotion",
        version=__version__,
        instructions="Text to 3D human motion. Look at the strip that a tool returns before you "
        "answer; generate again with another seed or wording if it does not show what was asked.",
        log_level="WARNING",
    )

    def told(tool: Callable[..., Any]) -> Callable[..., Any]:
        """Makes errors of the input what the agent reads, and tells doubts."""

        @wraps(tool)
        def run(*arguments: Any, **named: Any) -> Any:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # doubts stand in the motion's notes
                    return tool(*arguments, **named)
            except LatentMotionError as error:
                raise ToolError(str(error)) from error

        return run

    for name in ("generate", "direct", "describe", "search", "retarget", "render"):
        tool = told(getattr(tools, name))
        # Only a search is structured: pictures are not JSON.
        tool_server.add_tool(tool, name=name, structured_output=name == "search")
    tool_server.resource(
        "latentmotion://scene.schema.json", name="scene", mime_type="application/schema+json"
    )(lambda: SCHEMA_FILE.read_text(encoding="utf-8"))
    return tool_server
