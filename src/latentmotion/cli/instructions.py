"""`latentmotion evaluate --instructions`: does a model do what it is told? Without PyTorch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from latentmotion.cli.loading import load_generator
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.evaluation.instructions.answers import Asking, answers
from latentmotion.evaluation.instructions.benchmark import judge
from latentmotion.evaluation.instructions.joints_folder import read_folder
from latentmotion.evaluation.instructions.prompts import instructions, write_prompts
from latentmotion.evaluation.instructions.report import PAGE_FILE, REPORT_FILE, table, write
from latentmotion.evaluation.instructions.truth import Claimed, claimed
from latentmotion.runtime.computing import Computing
from latentmotion.storage.files import check_replaceable

if TYPE_CHECKING:
    from latentmotion.cli.evaluate import Evaluate

Joints = Float[np.ndarray, "_ 22 3"]


def measure_instructions(options: Evaluate) -> None:
    """Writes the prompts, or checks the motions of a model or of a folder of joints.

    Raises:
        InputError: Options contradict each other, or a file cannot be written.
        DataError: The joints or the data set lack something.
        ModelError: The model cannot be asked.
    """
    if options.takes < 1:
        raise InputError(f"--takes {options.takes}: expected 1 or more")
    if options.prompts is not None:
        write_prompts(options.prompts, options.takes)
        print(f"wrote {options.prompts}: {len(instructions())} prompts")
        return
    if options.output is not None:
        check_replaceable(options.output, REPORT_FILE)
    real = _real(options.data, options.split)
    subject, about, motions = _given(options) if options.joints else _made(options)
    found = judge(subject, about, instructions(), motions, real)
    print(table(found))
    if options.output is not None:
        write(found, options.output)
        print(f"\nwrote {options.output / REPORT_FILE} and {PAGE_FILE}")


def _real(data: Path | None, split: str) -> list[Claimed]:
    return [] if data is None else claimed(Dataset.load(data), split)


def _given(options: Evaluate) -> tuple[str, dict[str, str], Sequence[Sequence[Joints]]]:
    assert options.joints is not None
    if options.model is not None:
        raise InputError(f"give either MODEL ({options.model}) or --joints, not both")
    folder = options.joints
    motions = read_folder(folder, instructions(), options.takes, options.fps)
    return folder.name or "joints", {"joints": folder.name, "takes": str(options.takes)}, motions


def _made(options: Evaluate) -> tuple[str, dict[str, str], Sequence[Sequence[Joints]]]:
    if options.model is None:
        raise InputError("MODEL is missing; name one, or a folder of joints by --joints")
    computing = Computing(options.device, options.precision, options.launch)
    generator = load_generator(
        options.model, text_encoder=options.text_encoder, computing=computing
    )
    card = generator.card
    sampling = card.sampling.but(options.steps, options.guidance, options.sampler)
    asking = Asking(options.takes, options.clean, sampling)
    about = {
        "model": card.name,
        "steps": str(sampling.steps),
        "guidance": f"{sampling.guidance:g}",
        "sampler": sampling.sampler,
        "takes": str(asking.takes),
        "motions": "cleaned" if asking.clean else "as the network made them",
    }
    return card.name, about, answers(generator, instructions(), asking)
