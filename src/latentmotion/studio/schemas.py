"""Bodies of the studio's requests, as OpenAPI describes them.

Answers are what the library and its models say of themselves (`StoredTake.about`,
`Character.about`, `models.capabilities_of`), as JSON.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from latentmotion.service import schemas as service
from latentmotion.storage.limits import MOST_GOALS
from latentmotion.studio.library import ID, MOST_TITLE

CHARACTER_FORMATS = ["glb", "bvh"]  # Formats of takes on a character.

MOST_TAKES = 16  # Takes of a recipe that are made at once.

MOST_BEST_OF = 32  # Motions of which the best becomes a take.

MOST_EXPORTED = 500  # Most takes of one archive.


@dataclass(frozen=True)
class _Matching:
    """A text that a pattern matches as a whole; the error describes what is expected."""

    pattern: str
    expected: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self._matched, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "pattern": f"^{self.pattern}$"}

    def _matched(self, text: str) -> str:
        if not re.fullmatch(self.pattern, text):
            context = {"found": repr(text[:60]), "expected": self.expected}
            raise PydanticCustomError("text", "found {found}, expected {expected}", context)
        return text


Id = Annotated[str, _Matching(ID, "the name of a take or character, 26 to 32 letters and digits")]
# Name of a project, which is that of its file.
ProjectName = Annotated[
    str,
    _Matching(
        r"[^\W_]([\w\- ]{0,78}[\w\-])?",
        "a name of letters, digits, spaces, - and _, at most 80 of them, no / or .",
    ),
]
# Name of a file as its user calls it; it is shown and never opened.
FileName = Annotated[
    str, _Matching(r"[^\x00-\x1f\x7f/\\]{1,200}", "the name of a file without folders")
]
Title = Annotated[
    str, _Matching(rf"[^\x00-\x1f\x7f]{{1,{MOST_TITLE}}}", f"1 to {MOST_TITLE} letters in a line")
]
Tag = Annotated[
    str,
    _Matching(
        r"[^\x00-\x20\x7f]([^\x00-\x1f\x7f]{0,48}[^\x00-\x20\x7f])?",
        "1 to 50 letters in a line, no spaces around them",
    ),
]
# Name of a model in the list of models; no folder is opened by it.
ModelName = Annotated[str, Field(min_length=1, max_length=500)]
Span = tuple[Annotated[service.Number, Field(ge=0)], Annotated[service.Number, Field(gt=0)]]


class PoseGoal(service.RequestModel):
    """All joints are where they are in a frame of a take, as it is shown."""

    at: service.Number
    """Seconds."""
    take: Id
    """The take."""
    frame: int = 0
    """Its frame; a negative one counts from the end."""


class Edit(service.RequestModel):
    """A part of a take is generated anew; the prompt says what the person does there."""

    take: Id
    """The take, as it is shown."""
    between: Span
    """Start and end of the part, seconds."""
    parts: list[str] = Field(default_factory=list, max_length=16)
    """Parts of the body that change; by default all."""


class Transition(service.RequestModel):
    """What leads from one take to another; `seconds` says how long it takes."""

    start: Id
    """The take that it leads from."""
    end: Id
    """The take that it leads to."""


class Recipe(service.SceneRequest):
    """Recipe of a take: a scene, or a loop, an edit or a transition, and its sampling."""

    poses: list[PoseGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Whole poses."""
    start: Id | None = None
    """The take in whose last pose the motion begins."""
    edit: Edit | None = None
    """The part of a take that is generated anew."""
    between: Transition | None = None
    """The two takes between which it leads."""
    best_of: int = Field(1, ge=1, le=MOST_BEST_OF, strict=True)
    """Motions of which the best becomes the take."""
    in_place: bool = False
    """Show it without root motion along the floor at first."""
    format: Literal[1] = 1
    """Version of the scene format."""
    model: str | None = None
    """Model that made it; read from takes, not from requests. So are those below."""
    weights: str | None = None
    """SHA-256 of the model's graphs and weights."""
    version: str | None = None
    """Version of Latent Motion."""
    sources: dict[str, Any] | None = None
    """Motion and edits of each take that it uses, as they were."""
    batch: list[int] | None = Field(None, max_length=MOST_TAKES)
    """Seeds of the takes that were made together with it."""


class TakesRequest(service.RequestModel):
    """Takes to make, all of one recipe, whose seed counts up."""

    recipe: Recipe
    """What to make."""
    takes: int = Field(4, ge=1, le=MOST_TAKES, strict=True)
    """Number."""
    model: ModelName | None = None
    """Model that makes them; by default the one that the studio was started with."""


class ModelChoice(service.RequestModel):
    """A model to load."""

    model: ModelName
    """Its name in the list of models."""


class TakeChanges(service.RequestModel):
    """Changes of a take; fields left out stay."""

    title: Title = ""
    """What the list shows."""
    tags: Annotated[list[Tag], AfterValidator(lambda tags: list(dict.fromkeys(tags)))] = Field(
        [], max_length=50
    )
    """Words of the user's choice."""
    star: bool = False
    """Marked as good."""
    trim: Span | None = None
    """Start and end, seconds of the stored motion; null for all of it."""
    speed: Annotated[service.Number, Field(gt=0)] = 1.0
    """Playback speed factor."""
    in_place: bool = False
    """Without root motion along the floor."""
    mirrored: bool = False
    """Left and right are swapped."""


class ExportRequest(service.RequestModel):
    """Takes to write into one archive."""

    ids: list[Id] = Field(min_length=1, max_length=MOST_EXPORTED)
    """The takes."""
    format: service.FileFormat = "glb"
    """Format of the files."""
    fps: service.Fps = None
    character: Id | None = None
    """Figure of the user that they are put on."""


class MappingChange(service.RequestModel):
    """Which bone of a character is which of our joints."""

    mapping: dict[str, str | None] = Field(max_length=100)
    """Our joints → its bones; null for none."""


class Project(service.RequestModel):
    """What a user works on: one JSON file."""

    format: Literal[1]
    """Version of the file."""
    name: str = ""
    """Its name, which is that of the file."""
    takes: list[Id] = Field(default_factory=list, max_length=1000)
    """Takes that are open."""
    timeline: list[service.SpanOfTimeline] = Field(default_factory=list, max_length=64)
    """Prompts, as in a scene."""
    goals: list[service.JointGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Places of joints."""
    headings: list[service.HeadingGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Directions of the body."""
    poses: list[PoseGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Whole poses."""
    path: service.PathGoal | None = None
    """The path of the pelvis."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """What the page keeps for itself."""
