"""Making: a recipe and its sources become motions, the same ones every time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from latentmotion import __version__
from latentmotion.cleanup import CleanUp, clean_batch
from latentmotion.control.edit import ON_THE_WAY, generate_between, generate_edited
from latentmotion.control.goals import Pose
from latentmotion.control.scene import Scene, loop_or_timeline
from latentmotion.engine.lengths import TAKE_QUANTILES
from latentmotion.errors import InputError
from latentmotion.motion import Motion
from latentmotion.pipeline import MotionPipeline
from latentmotion.representation.canonical import heading, turn
from latentmotion.storage.configuration import from_json
from latentmotion.studio.library import Edits, Library
from latentmotion.studio.schemas import Recipe

Made = tuple[Motion, dict[str, Any], str, Edits]  # Motion, recipe, title and edits of a take.

Source = Callable[[str], Motion]  # Returns the motion of a take.


@dataclass(frozen=True, eq=False)
class Maker:
    """A model and a library.

    Args:
        pipeline: The model.
        weights: SHA-256 of what it computes with.
        library: Library of the takes that recipes refer to.
    """

    pipeline: MotionPipeline
    weights: str
    library: Library

    def made(self, recipe: Recipe, takes: int) -> list[Made]:
        """Returns several takes of a recipe; those of a prompt alone as one batch.

        Raises:
            LatentMotionError: The recipe cannot be met.
        """
        edit, between = recipe.edit, recipe.between
        names = [*(pose.take for pose in recipe.poses), recipe.start, edit and edit.take]
        names += [between.start, between.end] if between else []
        used = {name: self.library.take(name) for name in filter(None, names)}
        sources = {
            name: {"motion": take.motion, "edits": vars(take.edits)} for name, take in used.items()
        }
        seeds = [recipe.seed + number * recipe.best_of for number in range(takes)]
        motions = motions_of(
            self.pipeline, recipe, seeds, lambda name: self.library.motion(used[name])
        )
        sampling = self.pipeline.card.sampling.but(recipe.steps, recipe.guidance, recipe.sampler)
        described = recipe.model_dump(mode="json") | {
            "steps": sampling.steps,
            "guidance": sampling.guidance,
            "model": self.pipeline.card.name,
            "weights": self.weights,
            "version": __version__,
            "sources": sources or None,
        }
        title = motions[0].caption or "motion"
        edits = Edits(in_place=recipe.in_place)
        return [
            (motion, described | {"seed": seed, "batch": seeds}, title, edits)
            for motion, seed in zip(motions, seeds, strict=True)
        ]

    def again(self, recipe: Mapping[str, Any]) -> Motion:
        """Returns the motion of a take's recipe, made again.

        Raises:
            LatentMotionError: A take that it uses is gone.
        """
        sources = recipe["sources"] or {}

        def source(name: str) -> Motion:
            entry = sources[name]
            return from_json(Edits, entry["edits"]).applied(self.library.stored(entry["motion"]))

        # Takes of versions that made no exact counts or turns do not say so.
        original = Recipe.model_validate({"exact_count": False, "exact_turn": False, **recipe})
        # In the batch that it was made in, on whose size the last bits of sums depend.
        seeds = original.batch or [original.seed]
        return motions_of(self.pipeline, original, seeds, source)[seeds.index(original.seed)]


def motions_of(
    pipeline: MotionPipeline, recipe: Recipe, seeds: Sequence[int], source: Source
) -> list[Motion]:
    """Returns the motions of a recipe, cleaned up if it says so.

    Args:
        pipeline: The model.
        recipe: Settings of the motions; its own seed is not read.
        seeds: Seed of each motion.
        source: Returns the motions of takes that the recipe uses.

    Raises:
        LatentMotionError: The recipe cannot be met.
    """
    scene, prompt, seconds = scene_of(recipe), recipe.prompt, recipe.seconds
    fps, sampled = pipeline.representation.fps, (recipe.steps, recipe.guidance)
    if recipe.edit is not None:
        edit = recipe.edit
        about = source(edit.take).resampled(fps), prompt, edit.between
        return [generate_edited(pipeline, *about, seed, *sampled, edit.parts) for seed in seeds]
    if recipe.between is not None:
        start, end = (source(n).resampled(fps) for n in (recipe.between.start, recipe.between.end))
        about = start, end, seconds or 1.0, prompt or ON_THE_WAY
        return [generate_between(pipeline, *about, seed, *sampled) for seed in seeds]
    steps = CleanUp(recipe.exact_count, recipe.exact_turn) if recipe.clean else None
    if scene.loop or scene.timeline:
        motions = [loop_or_timeline(pipeline, scene, seed, *sampled) for seed in seeds]
        return clean_batch(motions, steps) if steps else motions
    goals = scene.all_goals()
    goals += [Pose(pose.at, source(pose.take), pose.frame) for pose in recipe.poses]
    if recipe.start is not None:
        # A motion starts above the origin and faces +z, and so does the pose that it starts in.
        start = source(recipe.start)
        pose = start.joints[-1:].astype(np.float64)
        pose -= pose[0, 0] * (1, 0, 1)
        turned = turn(pose, -heading(pose[0], start.skeleton))
        goals.append(Pose(0.0, replace(start, joints=turned.astype(np.float32))))
    if goals or recipe.best_of > 1:
        settings = {"takes": recipe.best_of, "clean_up": steps}
        sampling = (*sampled, recipe.sampler)
        return [pipeline(prompt, seconds, n, *sampling, goals, **settings) for n in seeds]
    # By the seed, so that a take that is made again starts from what it started from.
    every_other = [seed % 2 == 0 for seed in seeds]
    quantiles = [TAKE_QUANTILES[seed % len(TAKE_QUANTILES)] for seed in seeds]
    settings = (*sampled, recipe.sampler, every_other, steps, quantiles)
    return pipeline.batch([prompt] * len(seeds), seconds, seeds, *settings)


def scene_of(recipe: Recipe) -> Scene:
    """Returns the scene of a recipe, once it is of one kind.

    Raises:
        InputError: It is of several, or has what its kind does not take.
    """
    goals = bool(recipe.goals or recipe.headings or recipe.path or recipe.poses or recipe.start)
    kinds = {
        "a timeline": bool(recipe.timeline),
        "a loop": recipe.loop,
        "an edit": recipe.edit is not None,
        "a transition": recipe.between is not None,
    }
    chosen = [name for name, there in kinds.items() if there]
    if len(chosen) > 1:
        raise InputError(f"the recipe is {' and '.join(chosen)}; expected one of them")
    for kind in chosen:
        if goals or recipe.best_of > 1 or recipe.sampler:
            raise InputError(f"{kind} takes no goals, sampler or best of several; leave them out")
    if recipe.edit is not None and recipe.seconds is not None:
        raise InputError("an edit is as long as the part it replaces; leave seconds out")
    return recipe.scene()
