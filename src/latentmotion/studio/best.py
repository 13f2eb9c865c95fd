"""Route of the best take: which of several does best what their prompt says, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import BaseModel

from latentmotion.errors import InputError
from latentmotion.ranking import best as ranking
from latentmotion.ranking.best import Take
from latentmotion.studio.library import Library
from latentmotion.studio.models import Models
from latentmotion.studio.schemas import MOST_TAKES, Id

# Difference of similarity, or meters per second that feet slide, that is worth a word.
_CLEAR = 0.02


class BestAnswer(BaseModel):
    """The take that scores best."""

    take: str | None
    """Its name; none where the takes cannot be scored."""
    reason: str
    """What it does better than the others."""
    scores: dict[str, float]
    """Score of each take, the higher the better."""


def routes(library: Library, models: Models) -> APIRouter:
    """Returns the route."""
    router = APIRouter()

    @router.get("/best", response_model=BestAnswer)
    def best(take: Annotated[list[Id], Query(min_length=1, max_length=MOST_TAKES)]) -> Any:
        """Score takes of one prompt as `best of` does, and say which is best."""
        takes = [library.take(name) for name in dict.fromkeys(take)]
        prompts = {item.recipe.get("prompt") or "" for item in takes}
        unknown = BestAnswer(take=None, reason="", scores={})
        if len(prompts) > 1 or not min(prompts).strip():
            return unknown
        pipeline = models.service.pipeline
        scorer = ranking.scorer_beside(pipeline.condition)
        motions = [library.motion(item) for item in takes]
        try:
            ranked = ranking.ranked(motions, pipeline.read(min(prompts)).prompt, scorer)
        except InputError:  # motions that the scorer does not read
            return unknown
        names = {id(motion): item.id for motion, item in zip(motions, takes, strict=True)}
        scores = {names[id(item.motion)]: round(item.score, 4) for item in ranked}
        return BestAnswer(take=next(iter(scores)), reason=reason(ranked), scores=scores)

    return router


def reason(ranked: Sequence[Take]) -> str:
    """Returns in words what the first of ranked takes does better than the others do."""
    first, others = ranked[0], ranked[1:]
    if not others:
        return "the only one"
    count = len(others)
    mean = {
        name: sum(getattr(take, name) for take in others) / count for name in ("text", "sliding")
    }
    words = []
    if first.claims > max(take.claims for take in others):
        words.append("counts and turns as the prompt says")
    if first.text > mean["text"] + _CLEAR:
        words.append("closest to the prompt")
    if first.sliding < mean["sliding"] - _CLEAR:
        words.append("feet slide less")
    return ", ".join(words) or "all are close"
