"""Bodies of requests and answers, as OpenAPI describes them: unknown fields are refused."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, WrapValidator, model_validator

from latentmotion.control.goals import Heading, LookAt, Reach
from latentmotion.control.scene import FORMAT, Scene, ScenePath, checked
from latentmotion.control.timeline import PartSpan, Span
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.errors import LatentMotionError
from latentmotion.pipeline import RawMotion
from latentmotion.service.batching import BatchSettings, Prompt
from latentmotion.storage import configuration, limits

MOST_CHARACTERS = 500  # Longest prompt, characters.

MOST_MOTIONS = 256  # Most motions of a batch or a job.

MOST_FIELDS = 32  # Most fields of a JSON object.

MOST_STEPS = 1000  # Most sampling steps: those of the noise schedule.

# fmt: off
# Formats in which motions can be written.
FileFormat = Literal[
    "json", "npz", "amass.npz", "csv", "bvh", "glb", "vrma", "fbx", "usda", "usdc", "usdz",
    "html", "png", "gif", "mp4",
]
# fmt: on

# `raw` is float32, little-endian: frames × joints × 3; `viewer` is what the page reads.
Format = Literal[FileFormat, "raw", "viewer"]

# Formats of uploaded motions.
Readable = Literal["npz", "npy", "csv", "bvh", "glb", "gltf", "usda", "usdc", "usdz"]

Character = Literal["glb", "gltf", "bvh"]  # Formats of uploaded characters.

Text = Annotated[str, Field(max_length=MOST_CHARACTERS, description="What the person does.")]
Seed = Annotated[
    int, Field(ge=0, lt=2**53, strict=True, description="Seed: the same gives the same motion.")
]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Seconds = Annotated[
    Number | None, Field(description="Length of a motion; by default predicted from the prompt.")
]
Steps = Annotated[
    int | None,
    Field(ge=1, le=MOST_STEPS, strict=True, description="Sampling steps; by default the model's."),
]
Guidance = Annotated[
    Number | None, Field(description="Guidance of the prompt; by default the model's own.")
]
Sampler = Annotated[SamplerName | None, Field(description="Sampler; by default the model's own.")]
Clean = Annotated[
    bool, Field(strict=True, description="Hold standing feet, put the figure on the floor, smooth.")
]
ExactCount = Annotated[
    bool,
    Field(
        strict=True,
        description="Clean-up makes it do an act as often as the prompt says, which changes its "
        "length, unless seconds are given.",
    ),
]
ExactTurn = Annotated[
    bool,
    Field(strict=True, description="Clean-up makes it turn by the degrees that the prompt names."),
]
Fps = Annotated[
    float | None,
    Field(ge=1, le=240, allow_inf_nan=False, description="Frames per second; by default as it is."),
]


class RequestModel(BaseModel):
    """A request, whose unknown fields are refused rather than ignored."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _check_fields(cls, data: Any) -> Any:
        """Refuses objects of many fields at once, since each unknown field is reported."""
        if isinstance(data, dict) and len(data) > MOST_FIELDS:
            raise ValueError(f"{len(data):,} fields, expected at most {MOST_FIELDS}")
        return data


def _read_as(kind: type) -> WrapValidator:
    """Reads a part of a scene as scene files are read; OpenAPI describes it by its docstrings."""

    def read(value: Any, handler: object) -> Any:
        try:
            part = configuration.from_json(kind, value)
        except (LatentMotionError, OverflowError) as error:  # a whole number of 400 digits
            raise ValueError(str(error)) from error
        json.dumps(vars(part), allow_nan=False)  # raises ValueError: no number is infinite or NaN
        for text in (text for text in vars(part).values() if isinstance(text, str)):
            text.encode()  # raises ValueError for halves of characters
            if len(text) > MOST_CHARACTERS:
                raise ValueError(f"{len(text):,} characters, expected at most {MOST_CHARACTERS}")
        return part

    return WrapValidator(read)


JointGoal = Annotated[Reach, _read_as(Reach)]
HeadingGoal = Annotated[Heading, _read_as(Heading)]
LookGoal = Annotated[LookAt, _read_as(LookAt)]
PathGoal = Annotated[ScenePath, _read_as(ScenePath)]
SpanOfTimeline = Annotated[Span, _read_as(Span)]
PartOfTimeline = Annotated[PartSpan, _read_as(PartSpan)]


class _Sampled(RequestModel):
    """Settings of sampling, and what becomes of the motion."""

    seconds: Seconds = None
    seed: Seed = 0
    steps: Steps = None
    guidance: Guidance = None
    sampler: Sampler = None
    clean: Clean = True
    exact_count: ExactCount = True
    exact_turn: ExactTurn = True

    def to_clean(self, raw: Sequence[RawMotion]) -> list[RawMotion]:
        """Returns motions without the corrections that the request leaves out."""
        return [
            replace(
                item,
                corrections=replace(
                    item.corrections,
                    turn=item.corrections.turn if self.exact_turn else None,
                    count=item.corrections.count if self.exact_count else None,
                ),
            )
            for item in raw
        ]

    def settings(self) -> BatchSettings:
        """Returns what motions need in common to be generated together."""
        return BatchSettings(self.steps, self.guidance, self.sampler, self.seconds is None)


class SceneRequest(_Sampled):
    """A motion to generate: a prompt, with goals if given, or a timeline of prompts."""

    prompt: Text = ""
    goals: list[JointGoal] = Field(default_factory=list, max_length=limits.MOST_GOALS)
    headings: list[HeadingGoal] = Field(default_factory=list, max_length=limits.MOST_GOALS)
    looks: list[LookGoal] = Field(default_factory=list, max_length=limits.MOST_GOALS)
    path: PathGoal | None = None
    timeline: list[SpanOfTimeline] = Field(default_factory=list, max_length=limits.MOST_SPANS)
    timeline_parts: list[PartOfTimeline] = Field(default_factory=list, max_length=limits.MOST_SPANS)
    loop: bool = False
    """Whether the last frame is the first, farther along a straight path."""

    def prompts(self) -> list[Prompt]:
        """Returns the prompt for the queue."""
        return [Prompt(self.prompt, self.seconds, self.seed)]

    def scene(self) -> Scene:
        """Returns the scene as `control` has it.

        Raises:
            InputError: It is of several kinds, or a goal or a time cannot be used.
        """
        shared = {field.name for field in fields(Scene)} - {"format", "poses"}
        values: dict[str, Any] = {name: getattr(self, name) for name in shared}
        return checked(Scene(FORMAT, **values), "the request")


# Requests that OpenAPI shows, by kind.
_EXAMPLES = json.loads(Path(__file__).with_name("examples.json").read_text(encoding="utf-8"))


class MotionRequest(SceneRequest):
    """A motion: a prompt, with goals if wanted, or a timeline of prompts."""

    model_config = ConfigDict(json_schema_extra={"examples": _EXAMPLES["motion"]})

    format: Format = "json"
    fps: Fps = None


class BatchRequest(_Sampled):
    """Several motions, with seeds that count up from the first."""

    model_config = ConfigDict(json_schema_extra={"examples": _EXAMPLES["batch"]})

    prompts: list[Text] = Field(min_length=1, max_length=MOST_MOTIONS)
    """What the person does in each motion."""
    count: int = Field(1, ge=1, le=MOST_MOTIONS, strict=True)
    """Motions per prompt; prompts times count are 256 at most, with seeds that count up."""
    format: Format = "npz"
    fps: Fps = None

    @model_validator(mode="after")
    def _check_motions(self) -> BatchRequest:
        if self.motions > MOST_MOTIONS:
            raise ValueError(
                f"{len(self.prompts)} prompts of count {self.count} are {self.motions:,} motions; "
                f"expected {MOST_MOTIONS} at most, ask for the others in another request"
            )
        return self

    @property
    def motions(self) -> int:
        """Number of motions."""
        return len(self.prompts) * self.count

    def all_prompts(self) -> list[Prompt]:
        """Returns the prompts for the queue."""
        texts = [text for text in self.prompts for _ in range(self.count)]
        return [Prompt(text, self.seconds, self.seed + n) for n, text in enumerate(texts)]


class StreamMessage(RequestModel):
    """A message of a stream's client; the first one has a prompt."""

    prompt: Text | None = None
    """What the person does from now on."""
    ack: int | None = Field(None, ge=0, le=2**53, strict=True)
    """Number of pieces that have been received; the service is never more than some ahead."""
    seed: Seed = 0
    """Seed of the stream; read from the first message alone."""
    steps: Steps = None
    """Sampling steps; read from the first message alone."""
    guidance: Guidance = None
    """Guidance scale; read from the first message alone."""


class AnswerModel(BaseModel):
    """An answer; the docstrings of its fields are their descriptions in the OpenAPI schema."""

    model_config = ConfigDict(use_attribute_docstrings=True)


class JobState(AnswerModel):
    """Progress of a job."""

    id: str
    """Name of the job, too random to be guessed."""
    state: Literal["queued", "running", "done", "failed"]
    """Progress of the job."""
    motions: int
    """Number of requested motions."""
    finished: int
    """Number of generated motions."""
    error: str | None = None
    """Reason of a failure."""


class ModelAnswer(AnswerModel):
    """The model that the service runs, and the requests that it accepts."""

    name: str
    """Name of the model."""
    license: str
    """License of its motions."""
    prompts: str
    """Its condition: sentences, labels or nothing."""
    labels: list[str]
    """The labels of an action model; empty for others."""
    seconds: tuple[float, float]
    """Shortest and longest motion."""
    fps: float
    """Frames per second."""
    joints: list[str]
    """Names of the joints."""
    parents: list[int]
    """Parent of each joint; -1 for the root."""
    formats: list[str]
    """Formats of motions that this installation writes."""
    lacking: dict[str, str]
    """Formats that need what is not installed, and what that is."""
    sampling: dict[str, Any]
    """The model's own steps, guidance and sampler."""
    directed: bool
    """Whether goals, timelines and streams can be requested."""
