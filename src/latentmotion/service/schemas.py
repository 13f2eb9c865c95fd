"""Bodies of requests and answers, as OpenAPI describes them: unknown fields are refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from latentmotion.control.goals import Goal, Heading, Path, Reach
from latentmotion.control.timeline import PartSpan, Span
from latentmotion.diffusion.samplers import SamplerName
from latentmotion.errors import InputError
from latentmotion.motion import Motion
from latentmotion.service.model import BatchSettings, Prompt
from latentmotion.storage.limits import MOST_GOALS, MOST_SPANS

MOST_CHARACTERS = 500
"""Of a prompt."""

MOST_MOTIONS = 256
"""Of a batch or a job."""

MOST_FIELDS = 32
"""Fields of an object."""

MOST_STEPS = 1000
"""Sampling steps."""

Format = Literal[
    "json", "raw", "npz", "amass.npz", "csv", "bvh", "glb", "usda", "usdc", "usdz", "html", "viewer"
]
"""`raw` is float32, little-endian: frames × joints × 3; `viewer` is what the page reads."""

FileFormat = Literal[
    "json", "npz", "amass.npz", "csv", "bvh", "glb", "usda", "usdc", "usdz", "html"
]
"""What an uploaded motion can be written as."""

Readable = Literal["npz", "npy", "csv", "bvh", "glb", "gltf", "usda", "usdc", "usdz"]
"""What an uploaded motion can be."""

Character = Literal["glb", "gltf", "bvh", "asf"]
"""What an uploaded character can be."""

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


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _check_fields(cls, data: Any) -> Any:
        """Refuses thousands of fields at once, each of which would be told as unknown."""
        if isinstance(data, dict) and len(data) > MOST_FIELDS:
            raise ValueError(f"{len(data):,} fields, expected at most {MOST_FIELDS}")
        return data


class JointGoal(_Strict):
    """A joint is at a place at a time."""

    joint: str = Field(max_length=100, examples=["right_wrist"])
    """Name of the joint."""
    at: Number
    """Seconds."""
    to: tuple[Number | None, Number | None, Number | None]
    """x, y and z, meters; null leaves a coordinate free."""


class HeadingGoal(_Strict):
    """The body faces a direction at a time."""

    at: Number
    """Seconds."""
    degrees: Number
    """0 is +z, 90 is +x."""


class PathGoal(_Strict):
    """The path of the pelvis."""

    points: list[tuple[Number, Number]] = Field(min_length=2, max_length=MOST_GOALS)
    """x and z of each point, meters."""
    at: list[Number] | None = Field(None, max_length=MOST_GOALS)
    """Seconds at which each is passed."""


class SpanOfTimeline(_Strict):
    """A prompt of a timeline."""

    prompt: Text
    """What the person does."""
    seconds: Number | None = Field(None, gt=0, le=60)
    """Length in seconds; by default as predicted from the prompt."""


class PartOfTimeline(_Strict):
    """A prompt that one part of the body follows during a timeline."""

    part: str = Field(max_length=100, examples=["right_arm"])
    """Name of the part: an arm, arms, a leg, legs, head or upper_body."""
    prompt: Text
    """What the person does, of which the part is taken."""
    start: Number
    """Seconds."""
    end: Number
    """Seconds."""


class _Sampled(_Strict):
    """Settings of sampling, and what becomes of the motion."""

    steps: Steps = None
    guidance: Guidance = None
    sampler: Sampler = None
    clean: Clean = True
    exact_count: ExactCount = True
    exact_turn: ExactTurn = True

    def to_clean(self, motions: Sequence[Motion]) -> list[Motion]:
        """Returns motions of which clean-up makes exact only what is wanted."""
        wanted = {"count": self.exact_count, "turn": self.exact_turn}
        if all(wanted.values()):
            return list(motions)
        return [
            replace(m, metadata={n: it for n, it in m.metadata.items() if wanted.get(n, True)})
            for m in motions
        ]

    def settings(self, predicted: bool) -> BatchSettings:
        """Returns what motions need in common to be generated together."""
        return BatchSettings(self.steps, self.guidance, self.sampler, predicted)


class SceneRequest(_Sampled):
    """What a motion shows: a prompt, with goals if wanted, or a timeline of prompts."""

    prompt: Text = ""
    seconds: Seconds = None
    seed: Seed = 0
    goals: list[JointGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    headings: list[HeadingGoal] = Field(default_factory=list, max_length=MOST_GOALS)
    path: PathGoal | None = None
    timeline: list[SpanOfTimeline] = Field(default_factory=list, max_length=MOST_SPANS)
    timeline_parts: list[PartOfTimeline] = Field(default_factory=list, max_length=MOST_SPANS)

    def prompts(self) -> list[Prompt]:
        """Returns the prompt for the queue."""
        return [Prompt(self.prompt, self.seconds, self.seed)]

    def spans(self) -> list[Span]:
        """Returns the timeline for `MotionPipeline`."""
        return [Span(span.prompt, span.seconds) for span in self.timeline]

    def part_spans(self) -> list[PartSpan]:
        """Returns what parts of the body do during the timeline, for `MotionPipeline`.

        Raises:
            InputError: Times are not ascending, or there is no timeline.
        """
        if self.timeline_parts and not self.timeline:
            raise InputError("timeline_parts needs a timeline that the whole body follows; add one")
        return [PartSpan(**span.model_dump()) for span in self.timeline_parts]

    def all_goals(self) -> list[Goal]:
        """Returns the goals for `MotionPipeline`."""
        found: list[Goal] = []
        if self.path is not None:
            times = None if self.path.at is None else tuple(self.path.at)
            found.append(Path(tuple(self.path.points), times))
        found += [Reach(goal.joint, goal.at, goal.to) for goal in self.goals]
        return found + [Heading(goal.at, goal.degrees) for goal in self.headings]


class MotionRequest(SceneRequest):
    """A motion: a prompt, with goals if wanted, or a timeline of prompts."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"prompt": "a person walks forward and sits down", "seconds": 4, "seed": 7},
                {"prompt": "a person walks", "seconds": 4, "format": "glb", "clean": True},
                {
                    "prompt": "a person walks forward",
                    "seconds": 4,
                    "goals": [{"joint": "right_wrist", "at": 3.5, "to": [None, 1.4, None]}],
                },
                {"timeline": [{"prompt": "a person walks", "seconds": 3}, {"prompt": "a jump"}]},
                {
                    "timeline": [{"prompt": "a person walks forward", "seconds": 5}],
                    "timeline_parts": [
                        {
                            "part": "right_arm",
                            "prompt": "a person waves the right hand",
                            "start": 1,
                            "end": 4,
                        }
                    ],
                },
            ]
        }
    )

    format: Format = "json"
    fps: Fps = None


class BatchRequest(_Sampled):
    """Several motions, with seeds that count up from the first."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"prompts": ["a person walks", "a person jumps"], "seconds": 4, "format": "npz"}
            ]
        }
    )

    prompts: list[Text] = Field(min_length=1, max_length=MOST_MOTIONS)
    """What the person does in each motion."""
    count: int = Field(1, ge=1, le=MOST_MOTIONS, strict=True)
    """Motions per prompt; prompts times count are 256 at most."""
    seconds: Seconds = None
    seed: Seed = 0
    """Seed of the first motion."""
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
        """Motions that are asked for."""
        return len(self.prompts) * self.count

    def all_prompts(self) -> list[Prompt]:
        """Returns the prompts for the queue."""
        texts = [text for text in self.prompts for _ in range(self.count)]
        return [Prompt(text, self.seconds, self.seed + n) for n, text in enumerate(texts)]


class StreamMessage(_Strict):
    """What a client of a stream says: the first message has a prompt."""

    prompt: Text | None = None
    """What the person does from now on."""
    ack: int | None = Field(None, ge=0, le=2**53, strict=True)
    """Number of pieces that have been received; the service is never more than some ahead."""
    seed: Seed = 0
    """Seed of the stream; read from the first message alone."""
    steps: Steps = None
    """Likewise."""
    guidance: Guidance = None
    """Likewise."""


class _Answer(BaseModel):
    model_config = ConfigDict(use_attribute_docstrings=True)


class JobState(_Answer):
    """Progress of a job."""

    id: str
    """Its name, which nobody can guess."""
    state: Literal["queued", "running", "done", "failed"]
    """What happens to it."""
    motions: int
    """Motions that are asked for."""
    made: int
    """Motions that are there."""
    error: str | None = None
    """Why it failed."""


class ProblemAnswer(_Answer):
    """A request that cannot be met (RFC 9457)."""

    type: str
    """about:blank: the status says what kind it is."""
    title: str
    """The status in words."""
    status: int
    """The status."""
    detail: str
    """What was found, what was expected and what to do."""
    errors: list[dict[str, str]] = []
    """The fields that cannot be used: `at` and `problem`."""


class ModelAnswer(_Answer):
    """The model that the service runs, and what may be asked for."""

    name: str
    """Name of the model."""
    license: str
    """License of its motions."""
    prompts: str
    """Its condition: sentences, labels or nothing."""
    labels: list[str]
    """The labels that it knows, if it takes labels."""
    seconds: tuple[float, float]
    """Shortest and longest motion."""
    fps: float
    """Frames per second."""
    joints: list[str]
    """Names of the joints."""
    parents: list[int]
    """Parent of each joint; -1 for the root."""
    formats: list[str]
    """Formats of motions."""
    sampling: dict[str, Any]
    """The model's own steps, guidance and sampler."""
    directed: bool
    """Goals, timelines and streams can be asked for."""
