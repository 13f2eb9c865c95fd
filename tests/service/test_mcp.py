"""MCP: agents' tools, called by the package's own client."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from latentmotion import Motion, MotionPipeline, load
from tests.support.walker import walker

pytest.importorskip("mcp", reason='needs mcp: pip install "latentmotion[mcp]"')

from mcp import Client, StdioServerParameters

from latentmotion.service.mcp import facts, server

TOOLS = {"generate", "direct", "describe", "search", "retarget", "render"}
PATH = {"prompt": "a person walks", "seconds": 4, "path": {"points": [[0, 0], [1, 3]]}}


@pytest.fixture(scope="module")
def pipeline() -> MotionPipeline:
    return MotionPipeline.from_pretrained(threads=1)


def call(target: Any, *calls: tuple[str, dict[str, Any]]) -> list[Any]:
    """Connects, checks the list of tools, and returns the answers."""

    async def run() -> list[Any]:
        async with Client(target) as client:
            tools = (await client.list_tools()).tools
            assert {tool.name for tool in tools} == TOOLS
            assert all(tool.description and tool.input_schema for tool in tools)
            return [await client.call_tool(name, given) for name, given in calls]

    return asyncio.run(run())


def test_an_agent_generates_looks_and_measures(pipeline: MotionPipeline, tmp_path: Path) -> None:
    made, drawn, told = call(
        server(pipeline, tmp_path),
        ("generate", {"prompt": "a person turns left", "file": "turn.bvh", "seconds": 4}),
        ("render", {"file": "turn.bvh"}),
        ("describe", {"file": "turn.bvh"}),
    )
    about = json.loads(made.content[0].text)
    assert about["wrote"] == ["turn.bvh"] and load(tmp_path / "turn.bvh")[0].seconds == 4
    for answer, place in ((made, 1), (drawn, 0)):
        assert answer.content[place].mime_type == "image/png"
        assert base64.b64decode(answer.content[place].data).startswith(b"\x89PNG")
    (shown,) = json.loads(told.content[0].text)
    assert shown["degrees_turned_left"] > 20
    assert about["shows"]["degrees_turned_left"] == pytest.approx(
        shown["degrees_turned_left"], abs=5
    )
    assert {"turn"} <= {act["act"] for act in shown["acts"]}


def test_an_agent_directs_searches_and_retargets(pipeline: MotionPipeline, tmp_path: Path) -> None:
    spans = [{"prompt": "a person walks forward", "seconds": 3}, {"prompt": "a person sits down"}]
    walked, sat, found, put = call(
        server(pipeline, tmp_path),
        ("direct", {"scene": PATH, "file": "path.npz"}),
        ("direct", {"scene": {"timeline": spans}, "file": "character.glb"}),
        ("search", {"sentence": "a person sits down", "count": 2}),
        ("retarget", {"file": "path.npz", "character": "character.glb", "output": "on.glb"}),
    )
    assert not any(answer.is_error for answer in (walked, sat, found, put))
    end = load(tmp_path / "path.npz")[0].joints[-1, 0]
    assert end[[0, 2]] == pytest.approx([1, 3], abs=0.02)
    hits = found.structured_content["result"]
    assert hits[0]["file"] == "character.glb" and hits[0]["score"] >= hits[-1]["score"]
    assert len(load(tmp_path / "on.glb")) == 2


@pytest.mark.parametrize(
    ("name", "given", "says"),
    [
        ("generate", {"prompt": "a person walks", "file": "walk.xyz"}, "known are"),
        ("generate", {"prompt": "a person walks", "file": "../walk.npz"}, "outside of"),
        ("describe", {"file": "none.bvh"}, "there is no file"),
        ("direct", {"scene": {"promt": "a person walks"}, "file": "walk.npz"}, "prompt"),
        (
            "direct",
            {"scene": PATH | {"path": {"points": [[0, 0], [1, 99]]}}, "file": "walk.npz"},
            "m/s",
        ),
    ],
)
def test_errors_say_what_to_do(
    pipeline: MotionPipeline, tmp_path: Path, name: str, given: dict[str, Any], says: str
) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    (answer,) = call(server(pipeline, folder), (name, given))
    assert answer.is_error and says in answer.content[0].text
    assert not list(tmp_path.rglob("*.*"))


def test_the_command_speaks_over_standard_input_and_output(tmp_path: Path) -> None:
    command = ["-m", "latentmotion", "mcp", "--folder", str(tmp_path)]
    program = StdioServerParameters(command=sys.executable, args=command, env=dict(os.environ))
    (made,) = call(program, ("generate", {"prompt": "a person jumps", "file": "jump.npz"}))
    assert not made.is_error and (tmp_path / "jump.npz").is_file()


def test_facts_of_a_walk_of_another_skeleton() -> None:
    walk = walker()
    motion = Motion(walk.joints().astype("f4"), walk.fps, walk.skeleton)
    assert facts(motion)["postures"] == ["stand"]
