"""Routes of the models: what each can do, and which makes takes at once."""

from __future__ import annotations

from typing import get_args

from fastapi import APIRouter

from latentmotion import __version__
from latentmotion.control.parts import PARTS
from latentmotion.service.schemas import FileFormat, Readable
from latentmotion.service.state import about
from latentmotion.studio.files import CHARACTER_FORMATS
from latentmotion.studio.models import Models, StudioModel
from latentmotion.studio.schemas import (
    MOST_BEST_OF,
    Capabilities,
    ModelChoice,
    ModelsAnswer,
    OfferedModel,
)

_USUAL_STEPS = (10, 25, 50, 100)
"""Numbers of steps to offer for models that take any."""


def routes(models: Models) -> APIRouter:
    """Returns the routes of the models."""
    router = APIRouter()

    @router.get("/capabilities")
    def capabilities() -> Capabilities:
        """Describe what the model can do that the studio was started with."""
        return capabilities_of(models, models.own)

    @router.get("/models")
    def listed() -> ModelsAnswer:
        """List the models that takes can be made with, and what each can do."""
        return ModelsAnswer(models=[offered(model) for model in models.all.values()])

    @router.post("/models")
    def loaded(choice: ModelChoice) -> OfferedModel:
        """Load a model, so that its first takes need not wait; another one leaves the memory."""
        model = models.named(choice.model)
        models.maker(model.name)
        return offered(model)

    def offered(model: StudioModel) -> OfferedModel:
        return OfferedModel(
            name=model.name,
            weights=model.weights,
            loaded=models.is_loaded(model),
            capabilities=capabilities_of(models, model),
        )

    return router


def capabilities_of(models: Models, model: StudioModel) -> Capabilities:
    """Returns what a model can do."""
    pipeline = models.opened(model)
    facts, card = about(pipeline), pipeline.card
    few, usual = card.few_step, card.sampling
    least, most = few.guidance if few else (1.0, max(15.0, usual.guidance))
    best_of = card.condition.reads_text and MOST_BEST_OF
    kinds = ("goals", "path", "timeline", "loop", "between", "edit", "parts", "start")
    return Capabilities(
        **facts.model_dump(
            include={"license", "lacking", "prompts", "labels", "fps", "joints", "parents"}
        ),
        model=model.name,
        steps=sorted(few.steps if few else {*_USUAL_STEPS, usual.steps}),
        usual_steps=usual.steps,
        guidance={"least": least, "most": most, "usual": usual.guidance},
        seconds=dict(zip(("least", "most"), facts.seconds, strict=True)),
        parts=list(PARTS),
        directions=pipeline.representation.skeleton.offsets.round(4).tolist(),
        formats=[name for name in get_args(FileFormat) if name in facts.formats],
        character_formats=CHARACTER_FORMATS,
        readable=list(get_args(Readable)),
        can=dict.fromkeys(kinds, facts.directed)
        | {"best_of": best_of, "teach": bool(pipeline.moves)},
        least_steps={"timeline": 2, "loop": 2},
        models=list(models.all),
        library=str(models.library.folder.absolute()),
        version=__version__,
    )
