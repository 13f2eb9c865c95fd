"""Options that would have no effect are refused by one line, before any work."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from tyro.conf import Positional

from latentmotion.cli import options
from latentmotion.cli.main import main
from latentmotion.errors import InputError
from latentmotion.evaluation.evaluators.action import MotionGRUConfig
from latentmotion.motion import Motion
from tests.cli.conftest import Refused
from tests.support.moving_figures import write_moving_figures
from tests.support.walker import walker

TIMELINE = "a timeline is sampled from noise by the model's own sampler, so"
LENGTHS = "the prompts of a timeline have lengths of their own, so --seconds has no effect"
PRIOR = "--prior decodes random latents, so"
INSTRUCTIONS = "instructions have prompts, lengths, seeds and checks of their own, so"
UNUSED = {
    "generate --prior --steps 4 --sampler heun": f"{PRIOR} --steps and --sampler have no effect",
    "generate --prior --guidance 3": f"{PRIOR} --guidance has no effect; leave it out",
    "generate --prior --moves data": f"{PRIOR} --moves",
    "generate --prior --text-encoder clip": f"{PRIOR} --text-encoder",
    "generate --scene spans.json --seconds 3": LENGTHS,
    "generate --scene spans.json --sampler heun": f"{TIMELINE} --sampler",
    "generate --scene spans.json --reach head@1=0,1,0": "takes no goals, so --reach has no effect",
    "generate --scene spans.json --path 0,0": "takes no goals, so --path has no effect",
    "generate --timeline walk --seconds 3": LENGTHS,
    "generate --timeline walk --sampler heun --moves data": f"{TIMELINE} --sampler and --moves",
    "generate --timeline walk --heading 90@1": "takes no goals, so --heading has no effect",
    "generate walk --reach head@1=0,1,0 --moves data": "starts from noise, so --moves has no",
    "generate walk --no-from-clips --moves data": "starts all motions from noise, so --moves",
    "generate walk --steps 1 --moves data": "one step starts from noise, so --moves has no effect",
    "bulk --check -o data --seconds 3": "compares files alone, so --seconds has no effect",
    "bulk prompts.txt --check --shard 1/2 -o data": "--check makes nothing, so --shard has no",
    "clean a.npz -o b.npz --no-smooth --cutoff 3": "leaves jitter as it is, so --cutoff has no",
    "render a.npz -o a.html --size 300": "no .mp4 or .gif or .png is written, so --size has no",
    "render a.npz -o a.gif --style path": "no .png is written, so --style has no effect",
    "render a.npz -o a.png a.html --camera still": "no .mp4 or .gif is written, so --camera has",
    "join a.npz a.npz --seconds 0 --steps 4": "joins by cuts, so --steps has no effect",
    "fit space.npz --focal 900": "space.npz has points in 3D, so --focal has no effect",
    "fit picture.npz --up z --unit cm": "has points in a picture, so --unit and --up have no",
    "convert evaluator gru.tar -o out --glove data": "an action classifier, so --glove has no",
    "evaluate fast --data data --takes 3": "--instructions, metrics are measured, so --takes",
    "evaluate fast --data data --prior --guidance 2": f"{PRIOR} --guidance has no effect",
    "evaluate fast --instructions --evaluator data": f"{INSTRUCTIONS} --evaluator has no effect",
    "evaluate fast --instructions --seed 3 --cost": f"{INSTRUCTIONS} --seed and --cost have no",
    "evaluate fast --instructions --split val": "no captions are read, so --split has no effect",
    "evaluate fast --instructions --fps 30": "without --joints no joint files are read, so --fps",
    "evaluate --joints data --no-clean": "measures motions that are there, so --no-clean has no",
    "evaluate fast --prompts a.csv": "--prompts writes the list of prompts alone, so MODEL has no",
    "train length --captions a -o b --trials.prompts 5": "nothing is generated, so --trials has no",
    "data describe . -o a.csv --windows 2": ". is no prepared data, so --windows has no effect",
    "data describe data -o out --unit cm": "data is prepared data, so --unit has no effect",
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that could all be used."""
    place = tmp_path_factory.mktemp("place")
    write_moving_figures(place / "data", train=1, val=1)
    joints = walker(30).joints().astype("f4")
    Motion(joints).save(place / "a.npz")
    names = Motion(joints).skeleton.names
    np.savez(place / "space.npz", points=joints, fps=20.0, names=names)
    np.savez(place / "picture.npz", points=joints[..., :2], fps=20.0, names=names)
    spans = [{"prompt": "a person walks", "seconds": 2}]
    (place / "spans.json").write_text(json.dumps({"format": 1, "timeline": spans}))
    (place / "prompts.txt").write_text("a person walks\n")
    torch.save({"model": MotionGRUConfig().build().state_dict()}, place / "gru.tar")
    return place


@pytest.mark.parametrize("words", UNUSED)
def test_one_line_says_what_has_no_effect(words: str, place: Path, refused: Refused) -> None:
    assert UNUSED[words] in refused(words, place)


def test_names_of_options_are_those_of_the_command_line() -> None:
    @dataclass(frozen=True)
    class Command:
        files: Positional[tuple[str, ...]] = ()
        clean: bool = True
        json: bool = False
        some_number: int = 3

    options.refuse_unused(Command(), "why", "files", "clean", "json", "some_number")
    options.refuse_unused(Command(json=True), "why", "clean")
    with pytest.raises(
        InputError,
        match=r"^why, so FILES, --no-clean, --json and --some-number have no effect; leave them",
    ):
        options.refuse_unused(Command(("a",), False, True, 4), "why", *vars(Command()))


def test_a_seed_beside_a_scene_that_has_one(tmp_path: Path) -> None:
    scene = {"format": 1, "prompt": "a person walks", "seconds": 2, "seed": 5}
    (tmp_path / "a.json").write_text(json.dumps(scene))
    words = ["generate", "--scene", str(tmp_path / "a.json"), "--best-of", "1"]
    seeds = []
    for more in ([], ["--seed", "0"], ["--seed", "7"]):
        main([*words, *more, "-o", str(tmp_path / "a.npz")])
        seeds.append(Motion.load(tmp_path / "a.npz").metadata["seed"])
    assert seeds == [5, 0, 7]
