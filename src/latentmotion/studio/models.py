"""Models of the studio: those that takes can be made with, of which two are in memory at most.

Their routes say what each can do, and which makes takes at once.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Lock
from typing import Any, get_args

from fastapi import APIRouter

from latentmotion import __version__
from latentmotion.control.edit import PARTS
from latentmotion.errors import InputError, ModelError, hint
from latentmotion.model import card as cards
from latentmotion.pipeline import MotionPipeline
from latentmotion.service import batching, schemas, state
from latentmotion.studio.library import Library
from latentmotion.studio.making import Maker
from latentmotion.studio.schemas import CHARACTER_FORMATS, MOST_BEST_OF, ModelChoice


@dataclass(frozen=True, eq=False)
class StudioModel:
    """A model that takes can be made with, known by its card; its networks are not in memory."""

    name: str  # Its name in the studio.
    folder: Path  # Where it is.
    card: cards.ModelCard  # Its description.

    @cached_property
    def weights(self) -> str:
        """SHA-256 of its graphs and weights, and of those that read its prompts."""
        files = [file for file in self.folder.iterdir() if file.suffix in (".onnx", ".safetensors")]
        if self.card.condition.reads_text:
            lengths = cards.file_beside(self.card, self.folder, cards.LENGTHS_FILE)
            files += cards.find_text_encoder(self.card, self.folder)
            files += [lengths] if lengths else []
        digest = hashlib.sha256()
        for file in sorted(set(files), key=lambda file: (file.name, file)):
            digest.update(file.name.encode() + b"\0" + file.read_bytes())
        return digest.hexdigest()


@dataclass(eq=False)
class Models:
    """The service's own model, which stays in memory, and others, of which one at a time does.

    Args:
        service: Runs its own model.
        library: Library of the takes that recipes refer to.
        others: Names, folders or hub ids of further models; those that ship are always there.

    Raises:
        InputError: A model moves another skeleton than the service's.
        ModelError: There is no such model, or it was not exported.
    """

    service: state.Service
    library: Library
    others: Sequence[str] = ()
    # Models by name, the service's first.
    all: dict[str, StudioModel] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._lock = Lock()
        self._own: Maker | None = None
        self._loaded: tuple[StudioModel, Maker] | None = None
        named = [_folder(source) for source in (self.service.settings.model, *self.others)]
        shipped = [_folder(source) for source in cards.shipped_models()]
        joints = self.service.pipeline.representation.skeleton.names
        for folder in dict.fromkeys(named + shipped):
            card = cards.read_card(folder)
            name = card.name if card.name not in self.all else f"{card.name} ({folder})"
            model = StudioModel(name, folder, card)
            names = self.opened(model).representation.skeleton.names
            if names == joints:
                self.all[name] = model
            elif folder in named:
                raise InputError(
                    f"model {name!r} moves {len(names)} joints, others than the {len(joints)} of "
                    f"{self.own.name!r}; give it a studio of its own: latentmotion studio --model "
                    f"{folder}"
                )

    @property
    def own(self) -> StudioModel:
        """The model of the service."""
        return next(iter(self.all.values()))

    def named(self, name: str | None) -> StudioModel:
        """Returns a model by name, the service's where it is None.

        Raises:
            InputError: There is none of this name.
        """
        if name is None:
            return self.own
        if name not in self.all:
            raise InputError(
                f"no model {name[:100]!r} in this studio; {hint(name[:100], list(self.all))}, or "
                "start it with another: latentmotion studio --model FOLDER"
            )
        return self.all[name]

    def is_loaded(self, model: StudioModel) -> bool:
        """Returns whether a model's networks are in memory."""
        loaded = self._loaded
        return model is self.own or (loaded is not None and loaded[0] is model)

    def opened(self, model: StudioModel) -> MotionPipeline:
        """Returns a model; its networks are loaded at their first use.

        Raises:
            ModelError: A file of it is missing.
        """
        if self.all and model is self.own:
            return self._taught(self.service.pipeline)
        settings = self.service.settings
        pipeline = MotionPipeline.from_pretrained(model.folder, settings.runtime, 1)
        return self._taught(pipeline.with_moves(*settings.moves))

    def _taught(self, pipeline: MotionPipeline) -> MotionPipeline:
        """Returns a model with the clips that the library teaches, where it was taught them."""
        file = self.library.folder / "moves" / cards.MOVES_FILE
        if not pipeline.moves or not file.is_file():
            return pipeline
        try:
            return pipeline.with_moves(file)
        except ModelError as error:  # of another model, or damaged
            print(f"warning: {error}", file=sys.stderr)
            return pipeline

    def forget(self) -> None:
        """Lets the next takes be made with the clips that the library teaches by now."""
        with self._lock:
            self._own = self._loaded = None

    def maker(self, name: str | None = None) -> Maker:
        """Returns what makes takes with a model; it is loaded if need be, and another given up.

        Raises:
            InputError: There is none of this name.
            ModelError: It cannot be loaded.
        """
        model = self.named(name)
        with self._lock:
            if model is self.own:
                self._own = self._own or Maker(self.opened(model), model.weights, self.library)
                return self._own
            if self._loaded is None or self._loaded[0] is not model:
                self._loaded = None  # before the next is read, so that two are there at most
                pipeline = batching.with_recent_prompts(self.opened(model))
                shortest = pipeline.card.frames[0] / pipeline.representation.fps
                pipeline.batch([batching.first_prompt(pipeline).text], shortest)
                self._loaded = model, Maker(pipeline, model.weights, self.library)
            return self._loaded[1]

    def maker_again(self, recipe: Mapping[str, Any]) -> Maker:
        """Returns what makes the take of a recipe again: the model with the same weights.

        Raises:
            InputError: The take was not made here, or none of the models has these weights.
            ModelError: The model cannot be loaded.
        """
        if not {"model", "weights"} <= recipe.keys():
            raise InputError("this take was imported, not generated; import its file again")
        candidates = sorted(self.all.values(), key=lambda model: model.name != recipe["model"])
        for model in candidates:
            if model.weights == recipe["weights"]:
                return self.maker(model.name)
        raise InputError(
            f"this take was made by model {recipe['model']!r}, whose weights (SHA-256 "
            f"{recipe['weights'][:12]}…) none of this studio's models has ({', '.join(self.all)}); "
            "start the studio with that model: latentmotion studio --model FOLDER"
        )


def _folder(source: str) -> Path:
    hub = cards.is_hub_id(source)
    return (cards.download(source) if hub else cards.find_model(source)).resolve()


# Numbers of steps to offer for models that take any.
_USUAL_STEPS = (10, 25, 50, 100)


def routes(models: Models) -> APIRouter:
    """Returns the routes of the models."""
    router = APIRouter()

    @router.get("/capabilities")
    def capabilities() -> dict[str, Any]:
        """Describe what the model can do that the studio was started with."""
        return capabilities_of(models, models.own)

    @router.get("/models")
    def listed() -> dict[str, Any]:
        """List the models that takes can be made with, and what each can do."""
        return described(models)

    @router.post("/models")
    def loaded(choice: ModelChoice) -> dict[str, Any]:
        """Load a model, so that its first takes need not wait; another one leaves the memory."""
        model = models.named(choice.model)
        models.maker(model.name)
        return _described(models, model)

    return router


def described(models: Models) -> dict[str, Any]:
    """Returns what each model can do; the first time, weights are hashed and formats tried."""
    return {"models": [_described(models, model) for model in models.all.values()]}


def _described(models: Models, model: StudioModel) -> dict[str, Any]:
    return {
        "name": model.name,
        "weights": model.weights,
        "loaded": models.is_loaded(model),
        "capabilities": capabilities_of(models, model),
    }


def capabilities_of(models: Models, model: StudioModel) -> dict[str, Any]:
    """Returns what a model can do: the page offers nothing else.

    Returns:
        As for `ModelAnswer`: model, license, lacking, prompts, labels, fps, joints, parents; and:
        `steps`, sampling steps to offer; `usual_steps`; least, most and usual `guidance`; least and
        most `seconds`; `parts` that can be generated alone; `directions`, the offset of each joint
        from its parent at rest, meters; `formats` and `character_formats` of files; `readable`
        ones; `can`, features that the model supports (`best_of` is the greatest number, or false);
        `least_steps` of what needs more than one; names of all `models`; folder of the `library`;
        `version`.
    """
    pipeline = models.opened(model)
    facts, card = state.about(pipeline), pipeline.card
    few, usual = card.few_step, card.sampling
    least, most = few.guidance if few else (1.0, max(15.0, usual.guidance))
    kinds = ("goals", "path", "timeline", "loop", "between", "edit", "parts", "start")
    can = dict.fromkeys(kinds, facts.directed) | {"teach": bool(pipeline.moves)}
    shared = {"license", "lacking", "prompts", "labels", "fps", "joints", "parents"}
    return facts.model_dump(include=shared) | {
        "model": model.name,
        "steps": sorted(few.steps if few else {*_USUAL_STEPS, usual.steps}),
        "usual_steps": usual.steps,
        "guidance": {"least": least, "most": most, "usual": usual.guidance},
        "seconds": dict(zip(("least", "most"), facts.seconds, strict=True)),
        "parts": list(PARTS),
        "directions": pipeline.representation.skeleton.offsets.round(4).tolist(),
        "formats": [name for name in get_args(schemas.FileFormat) if name in facts.formats],
        "character_formats": CHARACTER_FORMATS,
        "readable": get_args(schemas.Readable),
        "can": {**can, "best_of": card.condition.reads_text and MOST_BEST_OF},
        "least_steps": {"timeline": 2, "loop": 2},
        "models": list(models.all),
        "library": str(models.library.folder.absolute()),
        "version": __version__,
    }
