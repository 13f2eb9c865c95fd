"""Route of teaching: a take and sentences become a clip that takes start from at once."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import Field

from latentmotion.data.clip import Caption, Source
from latentmotion.data.recording import features_of
from latentmotion.errors import InputError
from latentmotion.model.card import MOVES_FILE
from latentmotion.pipeline import MotionPipeline
from latentmotion.retrieval.index import joined
from latentmotion.retrieval.teach import ShownClip, build_index
from latentmotion.service.schemas import AnswerModel, RequestModel, Text
from latentmotion.studio.library import Library, StoredTake
from latentmotion.studio.models import Models
from latentmotion.studio.schemas import Id


class TeachRequest(RequestModel):
    """Sentences that a take shows."""

    sentences: Annotated[list[Text], Field(min_length=1, max_length=20)]
    """What the person in it does, in one or several wordings."""
    model: str | None = None
    """Name of the model that learns it; by default that of the studio's start."""


class TeachAnswer(AnswerModel):
    """What the library teaches by now."""

    clips: int
    sentences: int


def routes(library: Library, models: Models) -> APIRouter:
    """Returns the route."""
    router = APIRouter()

    @router.post("/takes/{name}/teach")
    def taught(name: Id, body: TeachRequest) -> TeachAnswer:
        """Let takes of these sentences, and of near ones, start from a take."""
        take, model = library.take(name), models.named(body.model)
        index = teach(models.opened(model), library, take, body.sentences)
        models.forget()
        return TeachAnswer(clips=index[0], sentences=index[1])

    return router


def teach(
    pipeline: MotionPipeline, library: Library, take: StoredTake, sentences: list[str]
) -> tuple[int, int]:
    """Adds a take to the clips of a library; returns how many clips and sentences these are.

    Raises:
        InputError: There is no sentence, the take is too short, or the model cannot be taught.
        ModelError: The library's clips are damaged, or were taught to another model.
    """
    if not pipeline.moves:
        raise InputError(f"model {pipeline.card.name!r} cannot start from clips")
    features = features_of(library.motion(take), pipeline.representation)
    texts = [text.strip() for text in sentences if text.strip()]
    captions = tuple(Caption(text, 0, len(features)) for text in texts)
    source = Source(library.folder.name, "unknown", "")
    clip = ShownClip(take.id, source.name, take.title, features, captions)
    encoders = pipeline.feature_encoder, pipeline.text_encoder
    index = build_index([clip], [source], pipeline.card, *encoders).preferred()
    file = library.folder / "moves" / MOVES_FILE
    if file.is_file():
        index = joined([file], index.latent_space, index.text_encoder).joined(index)
    file.parent.mkdir(exist_ok=True)
    index.write(file)
    return len(index.clips), len(index.captions)
