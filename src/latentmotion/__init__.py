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

# Where each public name is, besides the imports above, which only type checkers run.
_HOMES = {
    name: module
    for module, names in {
        "control.edit": "generate_between generate_edited generate_joined",
        "control.fit_keypoints": "fit_motion",
        "control.goals": "Heading LookAt Pose Reach RootPath",
        "control.stream": "generate_loop generate_stream",
        "control.timeline": "generate_timeline",
        "data.dataset": "Dataset",
        "errors": "LatentMotionError",
        "formats": "load save",
        "formats.asf_amc": "read_asf_amc",
        "formats.bvh": "read_bvh write_bvh",
        "kinematics.humanoid": "to_humanml3d",
        "kinematics.skeleton": "Animation Skeleton",
        "motion": "Motion",
        "pipeline": "MotionPipeline",
    }.items()
    for name in names.split()
}

__all__ = ["__version__", *_HOMES]  # pyright: ignore[reportUnsupportedDunderAll]


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
