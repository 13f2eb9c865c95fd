"""Nodes for ComfyUI: sentences, timelines and goals become motion, characters, files, pictures.

Put this folder into ComfyUI's `custom_nodes`; it needs `pip install "latentmotion[video]"` in
ComfyUI's environment. Images are ComfyUI's own: (frames, height, width, 3) tensors from 0 to 1.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from latentmotion import Motion, MotionPipeline, generate_timeline
from latentmotion.control.scene import parse_path, parse_reach
from latentmotion.formats import ENDINGS
from latentmotion.render import video
from latentmotion.retarget import read_rig, transfer

MOTION = "LATENTMOTION_MOTION"
SEED = ("INT", {"default": 0, "min": 0, "max": 2**32 - 1})
SECONDS = (
    "FLOAT",
    {"default": 0.0, "min": 0.0, "max": 9.8, "step": 0.1, "tooltip": "0: as long as it takes"},
)
FILE_KINDS = [ending[1:] for ending in ENDINGS if ending not in (".gif", ".mp4", ".png")]


def text(default: str, hint: str = "", lines: bool = True) -> tuple[str, dict[str, Any]]:
    """Returns an input of text."""
    return "STRING", {"default": default, "multiline": lines, "tooltip": hint}


@cache
def model(name: str = "fast") -> MotionPipeline:
    """Returns the model, opened once."""
    return MotionPipeline.from_pretrained(name)


def output_file(name: str, ending: str) -> Path:
    """Returns the first free file of a name in ComfyUI's output folder."""
    import folder_paths  # ComfyUI's

    folder = Path(folder_paths.get_output_directory()).resolve()
    number = 1
    while (path := (folder / f"{name}_{number:05d}.{ending}").resolve()).exists():
        number += 1
    if not path.is_relative_to(folder):
        raise ValueError(f"{name}: expected a name in {folder}")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


class Node:
    """What all nodes share."""

    CATEGORY = "Latent Motion"
    FUNCTION = "run"
    RETURN_TYPES: ClassVar[tuple[str, ...]] = (MOTION,)
    RETURN_NAMES: ClassVar[tuple[str, ...]] = ("motion",)
    INPUTS: ClassVar[dict[str, Any]] = {}

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802
        """Returns the inputs, as ComfyUI asks for them."""
        return {"required": cls.INPUTS}


class Text(Node):
    """A sentence becomes motion: the best of several takes."""

    INPUTS: ClassVar = {
        "prompt": text("a person walks forward and waves"),
        "seconds": SECONDS,
        "seed": SEED,
        "takes": ("INT", {"default": 4, "min": 1, "max": 16}),
    }

    def run(self, prompt: str, seconds: float, seed: int, takes: int) -> tuple[Motion]:
        """Generates."""
        return (model()(prompt, seconds or None, seed, takes=takes),)


class Timeline(Node):
    """Several sentences become one motion."""

    INPUTS: ClassVar = {
        "timeline": text(
            "a person walks forward | 3\na person sits down",
            "A sentence a line, and after | its seconds",
        ),
        "seed": SEED,
    }

    def run(self, timeline: str, seed: int) -> tuple[Motion]:
        """Generates."""
        spans: list[str | tuple[str, float]] = []
        for line in filter(str.strip, timeline.splitlines()):
            prompt, bar, seconds = line.partition("|")
            spans.append((prompt.strip(), float(seconds)) if bar else prompt.strip())
        return (generate_timeline(model(), spans, seed).cleaned(),)


class Direct(Node):
    """A sentence becomes motion along a path, with joints at places."""

    INPUTS: ClassVar = {
        "prompt": text("a person walks"),
        "seconds": SECONDS,
        "seed": SEED,
        "path": text(
            "0,0 1,3", "x,z of points in meters; @ and seconds after each, or none", False
        ),
        "reach": text("", "Such as right_wrist@2.5=0.3,1.4,2.1; one a line"),
    }

    def run(self, prompt: str, seconds: float, seed: int, path: str, reach: str) -> tuple[Motion]:
        """Generates."""
        goals: list[Any] = [parse_reach(line) for line in reach.splitlines() if line.strip()]
        goals += [parse_path(path)] if path.strip() else []
        return (model()(prompt, seconds or None, seed, goals=goals),)


class Save(Node):
    """Writes a motion into ComfyUI's output folder."""

    OUTPUT_NODE = True
    RETURN_TYPES: ClassVar = ("STRING",)
    RETURN_NAMES: ClassVar = ("file",)
    INPUTS: ClassVar = {
        "motion": (MOTION,),
        "name": text("motion", lines=False),
        "format": (FILE_KINDS, {"default": "glb"}),
    }

    def run(self, motion: Motion, name: str, format: str) -> tuple[str]:
        """Writes the file."""
        return (str(motion.save(output_file(name, format))[0]),)


class Retarget(Node):
    """Puts a motion on a character: .glb, .vrm, .fbx or .bvh."""

    OUTPUT_NODE = True
    RETURN_TYPES: ClassVar = ("STRING",)
    RETURN_NAMES: ClassVar = ("file",)
    INPUTS: ClassVar = {
        "motion": (MOTION,),
        "character": text("character.glb", "Path of its file", False),
        "name": text("character", lines=False),
    }

    def run(self, motion: Motion, character: str, name: str) -> tuple[str]:
        """Writes the character moving."""
        rig = read_rig(character)
        path = output_file(name, rig.file.endings[0][1:])
        return (str(transfer.write(path, rig, [motion])[0]),)


class Render(Node):
    """Draws a motion: a picture for each frame, for previews, videos, or as a control image."""

    RETURN_TYPES: ClassVar = ("IMAGE",)
    RETURN_NAMES: ClassVar = ("frames",)
    INPUTS: ClassVar = {
        "motion": (MOTION,),
        "size": ("INT", {"default": 360, "min": 64, "max": 1080, "step": 2}),
        "fps": ("FLOAT", {"default": 16.0, "min": 1.0, "max": 60.0}),
    }

    def run(self, motion: Motion, size: int, fps: float) -> tuple[Any]:
        """Draws."""
        import torch  # ComfyUI's

        pictures = video.frames([motion.resampled(fps)], size)
        frames = [np.asarray(picture.convert("RGB"), np.float32) / 255 for picture in pictures]
        return (torch.from_numpy(np.stack(frames)),)


NODE_CLASS_MAPPINGS = {
    f"LatentMotion{node.__name__}": node
    for node in (Text, Timeline, Direct, Save, Retarget, Render)
}
NODE_DISPLAY_NAME_MAPPINGS = {
    name: f"Motion: {node.__name__}" for name, node in NODE_CLASS_MAPPINGS.items()
}
