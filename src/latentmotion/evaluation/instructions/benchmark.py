"""The instruction benchmark: shares of motions that fulfill their prompts, and its report.

Takes of one prompt resemble each other. Intervals are Wilson's (Wilson 1927) for the effective
number of independent motions (Kish 1965): n / (1 + (m - 1) ρ), with m takes per prompt and ρ the
correlation of takes of one prompt, estimated by analysis of variance, between 0 and 1.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from latentmotion.data.instructions import GROUPS, Instruction
from latentmotion.errors import InputError
from latentmotion.evaluation.instructions.body import Body
from latentmotion.evaluation.instructions.detectors import fulfills
from latentmotion.evaluation.instructions.ground_truth import CaptionClaim
from latentmotion.evaluation.instructions.motions import MIN_FRAMES, Joints
from latentmotion.evaluation.instructions.prompts import VERSION
from latentmotion.progress import counted
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import atomic_folder

OVERALL = "overall"
"""Name of all groups together."""

Z = 1.959964
"""Standard normal quantile of 95 % intervals."""


@dataclass(frozen=True)
class Share:
    """Share of motions that fulfill their prompts."""

    share: float
    """Share of all motions, 0 to 1."""
    low: float
    """Lower end of the 95 % interval."""
    high: float
    """Upper end of the 95 % interval."""
    motions: int
    """Number of motions."""
    prompts: int
    """Number of prompts, or of clips."""
    ever: float
    """Share of prompts with at least one motion that fulfills them."""

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

    id: str
    """Name of the prompt."""
    group: str
    """Its group."""
    prompt: str
    """The sentence."""
    check: str
    """The check, as text."""
    fulfilled: tuple[bool, ...]
    """Whether each take fulfills it."""
    seconds: tuple[float, ...]
    """Length of each take."""


@dataclass(frozen=True)
class Benchmark:
    """Results of the benchmark."""

    subject: str
    """Name of the model, or of the folder of motions."""
    about: Mapping[str, str]
    """Settings of the motions."""
    model: Mapping[str, Share]
    """Figures by group."""
    chance: Mapping[str, Share]
    """Figures of the same motions with the checks of other groups' prompts."""
    real: Mapping[str, Share]
    """Figures of real motions whose captions claim the same; empty without data."""
    trained: Mapping[str, Share]
    """Figures of the same motions by the checks that trainings and rankings learn from, which
    are no measure of them; empty where none are given."""
    outcomes: tuple[Outcome, ...]
    """All prompts."""
    real_outcomes: tuple[Outcome, ...] = field(default=())
    """All claims of real motions: `id` is the clip, `prompt` the caption."""
    version: int = VERSION
    """Version of the list of prompts."""


def judge(
    subject: str,
    about: Mapping[str, str],
    instructions: Sequence[Instruction],
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
        replace(
            outcome,
            fulfilled=tuple(map(trained[outcome.id], takes)),
        )
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


def outcome_of(instruction: Instruction, takes: Sequence[Body]) -> Outcome:
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
    instructions: Sequence[Instruction], bodies: Sequence[Sequence[Body]]
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
    for group in (*GROUPS, OVERALL):
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
