"""Latent Motion: sentences become 3D human motion, by diffusion in a VAE's latent space.

    from latentmotion import MotionPipeline

    generate = MotionPipeline.from_pretrained()
    motion = generate("a person walks forward and sits down", seconds=4, seed=7)
    motion.save("sit.bvh")

Public names are imported when first used, so that importing the package costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from latentmotion.plugins import register

if TYPE_CHECKING:
    from latentmotion.control.edit import generate_between as generate_between
    from latentmotion.control.edit import generate_edited as generate_edited
    from latentmotion.control.edit import generate_joined as generate_joined
    from latentmotion.control.fit_keypoints import fit_motion as fit_motion
    from latentmotion.control.goals import Heading as Heading
    from latentmotion.control.goals import LookAt as LookAt
    from latentmotion.control.goals import Pose as Pose
    from latentmotion.control.goals import Reach as Reach
    from latentmotion.control.goals import RootPath as RootPath
    from latentmotion.control.stream import generate_loop as generate_loop
    from latentmotion.control.stream import generate_stream as generate_stream
    from latentmotion.control.timeline import generate_timeline as generate_timeline
    from latentmotion.data.dataset import Dataset as Dataset
    from latentmotion.errors import LatentMotionError as LatentMotionError
    from latentmotion.formats import load as load
    from latentmotion.formats import save as save
    from latentmotion.formats.asf_amc import read_asf_amc as read_asf_amc
    from latentmotion.formats.bvh import read_bvh as read_bvh
    from latentmotion.formats.bvh import write_bvh as write_bvh
    from latentmotion.kinematics.humanoid import to_humanml3d as to_humanml3d
    from latentmotion.kinematics.skeleton import Animation as Animation
    from latentmotion.kinematics.skeleton import Skeleton as Skeleton
    from latentmotion.motion import Motion as Motion
    from latentmotion.pipeline import MotionPipeline as MotionPipeline

__version__ = "1.0.0rc1"

_HOMES = {
    "Animation": "kinematics.skeleton",
    "fit_motion": "control.fit_keypoints",
    "generate_between": "control.edit",
    "generate_edited": "control.edit",
    "generate_joined": "control.edit",
    "generate_loop": "control.stream",
    "generate_stream": "control.stream",
    "generate_timeline": "control.timeline",
    "Heading": "control.goals",
    "LookAt": "control.goals",
    "RootPath": "control.goals",
    "Pose": "control.goals",
    "Reach": "control.goals",
    "Dataset": "data.dataset",
    "LatentMotionError": "errors",
    "Motion": "motion",
    "MotionPipeline": "pipeline",
    "Skeleton": "kinematics.skeleton",
    "load": "formats",
    "read_asf_amc": "formats.asf_amc",
    "read_bvh": "formats.bvh",
    "save": "formats",
    "to_humanml3d": "kinematics.humanoid",
    "write_bvh": "formats.bvh",
}

__all__ = [
    "Animation",
    "Dataset",
    "Heading",
    "LatentMotionError",
    "LookAt",
    "Motion",
    "MotionPipeline",
    "Pose",
    "Reach",
    "RootPath",
    "Skeleton",
    "__version__",
    "fit_motion",
    "generate_between",
    "generate_edited",
    "generate_joined",
    "generate_loop",
    "generate_stream",
    "generate_timeline",
    "load",
    "read_asf_amc",
    "read_bvh",
    "save",
    "to_humanml3d",
    "write_bvh",
]


# What a motion does by rooms above it, which it does not import.
register("motion.cleaned", "latentmotion.cleanup:clean")
register("motion.objects", "latentmotion.formats.objects:objects_of")
register("motion.notebook", "latentmotion.formats.notebook:bundle")
register("motion.load", "latentmotion.formats:load")
register("motion.save", "latentmotion.formats:save")


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'latentmotion' has no attribute {name!r}")
    return getattr(import_module(f"latentmotion.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
