"""Bodies of the studio's requests and answers, as OpenAPI describes them."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from latentmotion.service.schemas import (
    MOST_GOALS,
    AnswerModel,
    FileFormat,
    Fps,
    HeadingGoal,
    JointGoal,
    Number,
    PathGoal,
    RequestModel,
    SceneRequest,
    SpanOfTimeline,
)
from latentmotion.studio.library import ID, MOST_TITLE, Edits

PROJECT_NAME = r"[^\W_]([\w\- ]{0,78}[\w\-])?"
FILE_NAME = r"[^\x00-\x1f\x7f/\\]{1,200}"
TITLE = rf"[^\x00-\x1f\x7f]{{1,{MOST_TITLE}}}"
TAG = r"[^\x00-\x20\x7f]([^\x00-\x1f\x7f]{0,48}[^\x00-\x20\x7f])?"
"""Patterns of texts."""

CHARACTER_FORMATS = ["glb", "bvh"]
"""Formats of takes on a character."""

MOST_TAKES = 16
"""Takes of a recipe that are made at once."""

MOST_BEST_OF = 32
"""Motions of which the best becomes a take."""

MOST_EXPORTED = 500
"""Most takes of one archive."""


def _matched(pattern: str, expected: str) -> AfterValidator:
    """Returns a validator of texts by a pattern, whose error describes the expected text."""

    def check(text: str) -> str:
        if not re.fullmatch(pattern, text):
            context = {"found": repr(text[:60]), "expected": expected}
            raise PydanticCustomError("text", "found {found}, expected {expected}", context)
        return text

    return AfterValidator(check)


Id = Annotated[
    str,
    _matched(ID, "the name of a take or character, 26 to 32 letters and digits"),
    Field(json_schema_extra={"pattern": f"^{ID}$"}),
]
ProjectName = Annotated[
    str,
    _matched(
        PROJECT_NAME, "a name of letters, digits, spaces, - and _, at most 80 of them, no / or ."
    ),
    Field(json_schema_extra={"pattern": f"^{PROJECT_NAME}$"}),
]
"""Name of a project, which is that of its file."""
FileName = Annotated[
    str,
    _matched(FILE_NAME, "the name of a file without folders"),
    Field(json_schema_extra={"pattern": f"^{FILE_NAME}$"}),
]
"""Name of a file as its user calls it; it is shown and never opened."""
Title = Annotated[
    str,
    _matched(TITLE, f"1 to {MOST_TITLE} letters in a line"),
    Field(json_schema_extra={"pattern": f"^{TITLE}$"}),
]
Tag = Annotated[
    str,
    _matched(TAG, "1 to 50 letters in a line, no spaces around them"),
    Field(json_schema_extra={"pattern": f"^{TAG}$"}),
]
ModelName = Annotated[str, Field(min_length=1, max_length=500)]
"""Name of a model in the list of models; no folder is opened by it."""
Span = tuple[Annotated[Number, Field(ge=0)], Annotated[Number, Field(gt=0)]]


class PoseGoal(RequestModel):
    """All joints are where they are in a frame of a take, as it is shown."""

    at: Number
    """Seconds."""
    take: Id
    """The take."""
    frame: int = 0
    """Its frame; a negative one counts from the end."""


class Edit(RequestModel):
    """A part of a take is generated anew; the prompt says what the person does there."""

    take: Id
    """The take, as it is shown."""
    between: Span
    """Start and end of the part, seconds."""
    parts: list[str] = Field(default_factory=list, max_length=16)
    """Parts of the body that change; by default all."""


class Transition(RequestModel):
    """What leads from one take to another; `seconds` says how long it takes."""

    start: Id
    """The take that it leads from."""
    end: Id
    """The take that it leads to."""


class Recipe(SceneRequest):
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


class TakesRequest(RequestModel):
    """Takes to make, all of one recipe, whose seed counts up."""

    recipe: Recipe
    """What to make."""
    takes: int = Field(4, ge=1, le=MOST_TAKES, strict=True)
    """Number."""
    model: ModelName | None = None
    """Model that makes them; by default the one that the studio was started with."""


class ModelChoice(RequestModel):
    """A model to load."""

    model: ModelName
    """Its name in the list of models."""


class TakeChanges(RequestModel):
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
    speed: Annotated[Number, Field(gt=0)] = 1.0
    """Playback speed factor."""
    in_place: bool = False
    """Without root motion along the floor."""
    mirrored: bool = False
    """Left and right are swapped."""


class ExportRequest(RequestModel):
    """Takes to write into one archive."""

    ids: list[Id] = Field(min_length=1, max_length=MOST_EXPORTED)
    """The takes."""
    format: FileFormat = "glb"
    """Format of the files."""
    fps: Fps = None
    character: Id | None = None
    """Figure of the user that they are put on."""


class MappingChange(RequestModel):
    """Which bone of a character is which of our joints."""

    mapping: dict[str, str | None] = Field(max_length=100)
    """Our joints → its bones; null for none."""


class Project(RequestModel):
    """What a user works on: one JSON file."""

    format: Literal[1]
    """Version of the file."""
    name: str = ""
    """Its name, which is that of the file."""
    takes: list[Id] = Field(default_factory=list, max_length=1000)
    """Takes that are open."""
    timeline: list[SpanOfTimeline] = Field(default_factory=list, max_length=64)
    """Prompts, as in a scene."""
    goals: list[JointGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Places of joints."""
    headings: list[HeadingGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Directions of the body."""
    poses: list[PoseGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    """Whole poses."""
    path: PathGoal | None = None
    """The path of the pelvis."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """What the page keeps for itself."""


class ReadingAnswer(AnswerModel):
    """What a model does not know of a prompt; said before a take is made, and once when it is."""

    notice: str = ""
    """Words that it does not know, or reads otherwise."""
    nearest: list[str] = Field(default_factory=list)
    """Captions near the prompt that it learned, where it does not know the prompt."""


class TakeAnswer(ReadingAnswer):
    """A take."""

    id: str
    made: str
    """When it was made, ISO 8601."""
    title: str
    recipe: dict[str, Any]
    motion: str
    """SHA-256 of the file of its motion."""
    seconds: float
    """Length with its edits, as it is shown and written; so are frames and fps."""
    frames: int
    fps: float
    stored_seconds: float
    """Length of the stored motion, which `trim` refers to."""
    tags: list[str]
    star: bool
    deleted: bool
    missing: bool
    """The file of its motion is gone."""
    damaged: bool
    """Its row in the database cannot be read; it can be deleted."""
    edits: Edits
    """How the stored motion is shown and written."""
    goals: list[dict[str, Any]] | None
    """Each goal, and how far the motion was from it before and after clean-up, centimeters."""


class TakesAnswer(AnswerModel):
    """Takes that were made."""

    takes: list[TakeAnswer]


class ListAnswer(TakesAnswer):
    """Some of the takes that there are."""

    total: int
    """Number of this kind."""
    tags: list[str]
    """Tags of all takes that are not deleted."""


class AgainAnswer(AnswerModel):
    """Whether a take could be made again."""

    equal: bool
    """Whether both motions are equal to the bit."""
    restored: bool
    """Its file was missing and is there again."""


class CharacterAnswer(AnswerModel):
    """A figure of the user."""

    id: str
    name: str
    bones: list[str]
    mapping: dict[str, str | None]
    """Our joints → its bones; null for none."""
    guessed: list[str]
    """Joints whose bones were guessed from shape, not known by name."""
    missing: list[str]
    """Joints that are needed and have no bone."""
    problem: str | None
    """Why no motion can be put on it yet."""
    deleted: bool


class CharactersAnswer(AnswerModel):
    """Figures of the user."""

    characters: list[CharacterAnswer]


class Capabilities(AnswerModel):
    """What the model can do; the page offers nothing else."""

    model: str
    license: str
    prompts: str
    labels: list[str]
    steps: list[int]
    """Numbers of sampling steps to offer."""
    usual_steps: int
    guidance: dict[str, float]
    """least, most and usual."""
    seconds: dict[str, float]
    """least and most."""
    fps: float
    joints: list[str]
    parents: list[int]
    directions: list[list[float]]
    """Offset of each joint from its parent at rest, meters."""
    parts: list[str]
    """Parts of the body that can be generated alone."""
    formats: list[str]
    """Formats that takes can be written in here."""
    lacking: dict[str, str]
    """Those that cannot, and what is missing."""
    character_formats: list[str]
    """Those for takes on a character."""
    readable: list[str]
    """Formats that can be imported."""
    can: dict[str, bool | int]
    """Features that the model supports; `best_of` is the greatest number, or false."""
    least_steps: dict[str, int]
    """Fewest steps of what needs more than one."""
    models: list[str]
    """Models that takes can be made with."""
    library: str
    """Folder of the library."""
    version: str


class OfferedModel(AnswerModel):
    """A model that takes can be made with."""

    name: str
    weights: str
    """SHA-256 of its graphs and weights, as recipes have it."""
    loaded: bool
    """It is in memory; another is loaded before its first take."""
    capabilities: Capabilities


class ModelsAnswer(AnswerModel):
    """Models that takes can be made with, that of the studio's start first."""

    models: list[OfferedModel]
