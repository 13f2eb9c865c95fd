"""The instruction benchmark: prompts, shares of motions that fulfill them, and the report.

Takes of one prompt resemble each other. Intervals are Wilson's (Wilson 1927) for the effective
number of independent motions (Kish 1965): n / (1 + (m - 1) ρ), with m takes per prompt and ρ the
correlation of takes of one prompt, estimated by analysis of variance, between 0 and 1.

Ground truth of the benchmark: claims of real motions' captions, tested by the same checks.

Claims are found by regular expressions in captions (`captions.csv`) and in labels of actions that
name sides and counts, as HDM05's do (`labels.csv`); a caption counts once per check. Stops are not
searched, since people mention them where a clip ends. Annotators err and describe only parts of
clips, so that figures are below 100 % even if every check is right.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from math import sqrt
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool

from latentmotion.data import instructions as held_out
from latentmotion.data.clip import Clip
from latentmotion.data.dataset import Dataset
from latentmotion.errors import DataError, InputError
from latentmotion.evaluation.instructions.detectors import Body, fulfills
from latentmotion.evaluation.instructions.motions import MIN_FRAMES, Joints
from latentmotion.progress import counted
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import atomic_file, atomic_folder
from latentmotion.storage.reading import read_table

_NEGATED = re.compile(r"\b(without|not|no|doesn't|never|or|as if|like)\b")


@dataclass(frozen=True)
class Pattern:
    """A claim that captions can make."""

    group: str  # Its group of instructions.
    words: re.Pattern[str]  # Expression in a lower-case caption.
    check: held_out.Check  # Check of the motion.

    def is_in(self, text: str) -> bool:
        """Returns whether a caption makes the claim; one of both sides claims no single side."""
        if _NEGATED.search(text) or not self.words.search(text):
            return False
        return self.group != "side" or not {"left", "right"} <= {*re.split(r"\W", text)}


@dataclass(frozen=True, eq=False)
class CaptionClaim:
    """A real motion with a claim of its caption."""

    clip: str  # Name of the clip, or its label if the label makes the claim.
    caption: str  # The caption, or the clip's name if the label makes the claim.
    group: str  # Group of the claim.
    check: held_out.Check  # Check of the motion.
    joints: Joints  # The motion.


def patterns(of: Literal["captions", "labels"]) -> tuple[Pattern, ...]:
    """Returns the claims that are searched."""
    return tuple(
        Pattern(row["group"], re.compile(row["pattern"]), held_out.parse(row["check"]))
        for _, row in read_table(Path(__file__).with_name(f"{of}.csv"), ())
    )


def claims_of(dataset: Dataset, split: str) -> list[CaptionClaim]:
    """Returns the real motions of a split whose captions claim what prompts ask for.

    A claim that several captions make of the same frames is one. If captions are tagged with parts
    of speech, as HumanML3D's are, those without tags (names of classes, rules) are left out.

    Raises:
        DataError: No caption of the split makes a claim.
    """
    clips = dataset.clips(split)
    tagged = any(caption.tokens for clip in clips for caption in clip.captions)
    known_claims = patterns("captions")
    claims = [
        claim for clip in clips for claim in caption_claims(dataset, clip, known_claims, tagged)
    ]
    # Clips of one label resemble each other, and count as takes of it.
    known_claims = patterns("labels")
    for clip in clips:
        fitting = [
            pattern for pattern in known_claims if clip.action and pattern.words.match(clip.action)
        ]
        if fitting and clip.frames >= MIN_FRAMES:
            joints = dataset.representation.decode(dataset.features(clip))
            label = str(clip.action)
            claims += [CaptionClaim(label, clip.id, p.group, p.check, joints) for p in fitting]
    if not claims:
        raise DataError(
            f"{dataset.folder}: no caption of the {split} split claims what can be checked; "
            "leave --data out"
        )
    return claims


def caption_claims(
    dataset: Dataset, clip: Clip, known_claims: Sequence[Pattern], tagged: bool
) -> Iterator[CaptionClaim]:
    """Yields the claims of a clip's captions.

    Args:
        dataset: Data set of the clip.
        clip: The clip.
        known_claims: Claims to search.
        tagged: Whether captions without parts of speech are left out.
    """
    counted: set[tuple[str, int, int]] = set()
    joints: Joints = np.zeros((0, 22, 3))
    # Captions of labeled clips are made from the label, which makes the claim.
    written = () if clip.action else clip.captions
    for caption in (item for item in written if item.tokens or not tagged):
        text = caption.text.lower()
        for pattern in known_claims:
            key = (str(pattern.check), caption.start_frame, caption.end_frame)
            if key in counted or not pattern.is_in(text):
                continue
            counted.add(key)
            if not len(joints):
                joints = dataset.representation.decode(dataset.features(clip))
            part = joints[caption.start_frame : caption.end_frame]
            if len(part) >= MIN_FRAMES:
                yield CaptionClaim(clip.id, caption.text, pattern.group, pattern.check, part)


VERSION = 2  # Version of prompts and checks; figures of different versions do not compare.

OVERALL = "overall"  # Name of all groups together.

Z = 1.959964  # Standard normal quantile of 95 % intervals.


@dataclass(frozen=True)
class Share:
    """Share of motions that fulfill their prompts."""

    share: float  # Share of all motions, 0 to 1.
    low: float  # Lower end of the 95 % interval.
    high: float  # Upper end of the 95 % interval.
    motions: int  # Number of motions.
    prompts: int  # Number of prompts, or of clips.
    ever: float  # Share of prompts with at least one motion that fulfills them.

    @classmethod
    def of(cls, verdicts: Sequence[Sequence[bool]]) -> Share:
        """Summarizes verdicts, one row per prompt, at least one in all."""
        rows = [np.array(row, bool) for row in verdicts if len(row)]
        whole = np.concatenate(rows)
        low, high = wilson(float(whole.mean()), effective_size(rows))
        ever = float(np.mean([row.any() for row in rows]))
        return cls(float(whole.mean()), low, high, len(whole), len(rows), ever)

    def __str__(self) -> str:
        return f"{100 * self.share:.0f} % ({100 * self.low:.0f}–{100 * self.high:.0f})"


def wilson(share: float, count: float) -> tuple[float, float]:
    """Returns Wilson's 95 % interval of a share of independent observations."""
    middle = (share + Z**2 / (2 * count)) / (1 + Z**2 / count)
    spread = share * (1 - share) / count + Z**2 / (4 * count**2)
    half = Z * sqrt(spread) / (1 + Z**2 / count)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def effective_size(rows: Sequence[Bool[np.ndarray, " _"]]) -> float:
    """Returns the effective number of independent motions, at least one per prompt."""
    sizes = np.array([len(row) for row in rows], float)
    count, groups = sizes.sum(), len(rows)
    if count == groups:
        return count
    usual = (count - (sizes**2).sum() / count) / max(groups - 1, 1)
    means = np.array([row.mean() for row in rows])
    grand = float((sizes * means).sum() / count)
    between = float((sizes * (means - grand) ** 2).sum()) / max(groups - 1, 1)
    within = float((sizes * means * (1 - means)).sum()) / (count - groups)
    spread = between + (usual - 1) * within
    # A single prompt, or takes without any spread: prompts count.
    rho = 1.0 if groups == 1 or spread <= 0 else float(np.clip((between - within) / spread, 0, 1))
    return count / (1 + (count / groups - 1) * rho)


@dataclass(frozen=True)
class Outcome:
    """One prompt with the results of its takes."""

    id: str  # Name of the prompt.
    group: str  # Its group.
    prompt: str  # The sentence.
    check: str  # The check, as text.
    fulfilled: tuple[bool, ...]  # Whether each take fulfills it.
    seconds: tuple[float, ...]  # Length of each take.


@dataclass(frozen=True)
class Benchmark:
    """Results of the benchmark."""

    subject: str  # Name of the model, or of the folder of motions.
    about: Mapping[str, str]  # Settings of the motions.
    model: Mapping[str, Share]  # Figures by group.
    # Figures of the same motions with the checks of other groups' prompts.
    chance: Mapping[str, Share]
    # Figures of real motions whose captions claim the same; empty without data.
    real: Mapping[str, Share]
    # Figures of the same motions by the checks that trainings and rankings learn from, which are no
    # measure of them; empty where none are given.
    trained: Mapping[str, Share]
    outcomes: tuple[Outcome, ...]  # All prompts.
    # All claims of real motions: `id` is the clip, `prompt` the caption.
    real_outcomes: tuple[Outcome, ...] = field(default=())
    version: int = VERSION  # Version of the list of prompts.


def judge(
    subject: str,
    about: Mapping[str, str],
    instructions: Sequence[held_out.Instruction],
    motions: Sequence[Sequence[Joints]],
    real: Sequence[CaptionClaim] = (),
    trained: Mapping[str, Callable[[Joints], bool]] | None = None,
) -> Benchmark:
    """Checks the motions of every prompt.

    Args:
        subject: Name of the model, or of the folder of motions.
        about: Settings of the motions.
        instructions: The prompts.
        motions: Takes of each prompt, 20 frames per second.
        real: Claims of real motions.
        trained: Checks that models were trained by, by the id of the prompt.

    Raises:
        InputError: A motion is too short, or not of 22 joints.
    """
    bodies = [[body_of(each) for each in takes] for takes in counted(motions, "judging prompts")]
    outcomes = [outcome_of(item, takes) for item, takes in zip(instructions, bodies, strict=True)]
    claims = []
    for claim in counted(real, "judging captions"):
        body = body_of(claim.joints)
        fulfilled, check = fulfills(body, claim.check), str(claim.check)
        claims.append(
            Outcome(claim.clip, claim.group, claim.caption, check, (fulfilled,), (body.seconds,))
        )
    drilled = [
        replace(outcome, fulfilled=tuple(map(trained[outcome.id], takes)))
        for outcome, takes in zip(outcomes, motions, strict=True)
        if trained and outcome.id in trained
    ]
    return Benchmark(
        subject=subject,
        about=about,
        model=shares(outcomes),
        chance=shares(chance_outcomes(instructions, bodies)),
        real=shares(claims),
        trained=shares(drilled),
        outcomes=tuple(outcomes),
        real_outcomes=tuple(claims),
    )


def body_of(joints: Joints) -> Body:
    """Returns the curves of a motion.

    Raises:
        InputError: It is too short, or not of 22 joints.
    """
    if joints.ndim != 3 or joints.shape[1:] != (22, 3) or len(joints) < MIN_FRAMES:
        raise InputError(
            f"joints of shape {joints.shape}; expected (frames, 22, 3), {MIN_FRAMES} frames or more"
        )
    return Body(joints)


def outcome_of(instruction: held_out.Instruction, takes: Sequence[Body]) -> Outcome:
    """Checks the takes of a prompt."""
    return Outcome(
        instruction.id,
        instruction.group,
        instruction.prompt,
        str(instruction.check),
        tuple(fulfills(body, instruction.check) for body in takes),
        tuple(body.seconds for body in takes),
    )


def chance_outcomes(
    instructions: Sequence[held_out.Instruction], bodies: Sequence[Sequence[Body]]
) -> list[Outcome]:
    """Checks motions of other groups' prompts, as many as each prompt has, always the same ones."""
    generator = np.random.default_rng(VERSION)
    outcomes = []
    for item in instructions:
        others = [
            takes
            for other, takes in zip(instructions, bodies, strict=True)
            if other.group != item.group
        ]
        rows = generator.integers(len(others), size=len(bodies[0]))
        outcomes.append(outcome_of(item, [others[row][take] for take, row in enumerate(rows)]))
    return outcomes


def shares(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """Returns figures by group and overall; motions of one prompt or clip are dependent."""
    figures: dict[str, Share] = {}
    for group in (*held_out.GROUPS, OVERALL):
        rows: dict[str, list[bool]] = {}
        for outcome in outcomes:
            if group in (outcome.group, OVERALL):
                rows.setdefault(outcome.id, []).extend(outcome.fulfilled)
        if rows:
            figures[group] = Share.of(list(rows.values()))
    return figures


REPORT_FILE = "instructions.json"
PAGE_FILE = "instructions.md"


def table(benchmark: Benchmark) -> str:
    """Returns the figures as a Markdown table, one line per group."""
    head = ["group", "prompts", benchmark.subject, "in some take", "real motions", "other prompts'"]
    head += ["by what trained it"] if benchmark.trained else []
    lines = [_line(head), "|---" * len(head) + "|"]
    for group, share in benchmark.model.items():
        real = benchmark.real.get(group)
        lines.append(
            _line(
                [
                    f"**{group}**" if group == OVERALL else group,
                    str(share.prompts),
                    str(share),
                    f"{100 * share.ever:.0f} %",
                    f"{real}, {real.motions} claims" if real else "–",
                    f"{100 * benchmark.chance[group].share:.0f} %",
                    *([str(benchmark.trained.get(group, "–"))] if benchmark.trained else []),
                ]
            )
        )
    return "\n".join(lines)


def markdown(benchmark: Benchmark) -> str:
    """Returns a page: the table, settings of the motions, every prompt."""
    takes = len(benchmark.outcomes[0].fulfilled)
    settings = [f"{name}: {value}" for name, value in benchmark.about.items()]
    prompts = [_line(["id", "prompt", "check", "fulfilled"]), "|---|---|---|---|"]
    for outcome in benchmark.outcomes:
        fulfilled = f"{sum(outcome.fulfilled)} of {takes}"
        prompts.append(_line([outcome.id, outcome.prompt, f"`{outcome.check}`", fulfilled]))
    return "\n\n".join(
        [
            f"# Instructions, version {benchmark.version}: {benchmark.subject}",
            table(benchmark),
            f"Motions that do what the prompt says, of {takes} per prompt, with 95 % intervals "
            "(Wilson, takes of a prompt taken as dependent); prompts with a take that does; real "
            "motions whose captions claim the like; the checks on motions of other prompts; the "
            "prompts by the detectors that models are trained by.",
            "\n".join(f"* {line}" for line in settings),
            "## Prompts",
            "\n".join(prompts),
        ]
    )


def write(benchmark: Benchmark, folder: str | Path) -> None:
    """Writes `instructions.json` and `instructions.md` in place of what is there.

    Raises:
        InputError: The folder cannot be written, or holds something else.
    """
    with atomic_folder(folder, REPORT_FILE) as temporary:
        text = json.dumps(to_json(benchmark), indent=1, ensure_ascii=False)
        (temporary / REPORT_FILE).write_text(text + "\n", encoding="utf-8")
        (temporary / PAGE_FILE).write_text(markdown(benchmark) + "\n", encoding="utf-8")


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


@cache
def instructions() -> tuple[held_out.Instruction, ...]:
    """Returns the list."""
    rows = read_table(Path(__file__).with_name("checks.csv"), ())
    checks = {row["id"]: held_out.parse(row["check"]) for _, row in rows}
    listed = held_out.instructions()
    return tuple(replace(instruction, check=checks[instruction.id]) for instruction in listed)


def write_prompts(path: str | Path, takes: int) -> None:
    """Writes the list as CSV, with a column of seeds.

    Raises:
        InputError: The file cannot be written.
    """
    columns = ("id", "group", "prompt", "check", "seconds", "seeds")
    with atomic_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in instructions():
            length = "" if row.seconds is None else f"{row.seconds:g}"
            seeds = " ".join(map(str, row.seeds(takes)))
            writer.writerow([row.id, row.group, row.prompt, str(row.check), length, seeds])
