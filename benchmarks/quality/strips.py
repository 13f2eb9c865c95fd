"""Qualitative strips: motions of the same prompts by several rows of a table, beside the real ones.

    python -m benchmarks.quality.strips 8 quality --data DATA --budget small --rows z0 fast -o OUT

The words after the number of prompts are those of `latentmotion experiment run`. The picture,
OUT/TABLE_strips.svg, has a line of cells for each prompt, a column for each row; of an action label
there are three lines. A cell shows stick
figures evenly in time, seen half from the front, without root motion; the left side is orange, the
right blue.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np

from latentmotion.cli.experiment import RunExperiment
from latentmotion.cli.usage import parsed
from latentmotion.errors import InputError
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.evaluate import build_test_set
from latentmotion.motion import Motion
from latentmotion.render.painter import half_front
from latentmotion.reproduce.runner import TableRunner
from latentmotion.reproduce.table import Row, rows_named
from latentmotion.storage.files import atomic_file

REAL = "Real"  # Heading of the column of real motions.

FIGURES = 7  # Figures of a cell.

TAKES = 3  # Motions of each action label.

# Width and height of a cell, a meter, and the line of a caption, in units of the picture.
_WIDTH, _HEIGHT, _METER, _BAND = 300, 96, 36, 20

_STYLE = (
    "text{font:11px sans-serif;fill:#3a404c}.h{font-weight:bold}"
    "path{fill:none;stroke-width:2.2;stroke-linecap:round;stroke-linejoin:round}"
    ".m{stroke:#3a404c}.l{stroke:#de8054}.r{stroke:#5880c4}.f{stroke:#cdd3dc;stroke-width:1}"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, help="prompts, or action labels, of the test split")
    options, words = parser.parse_known_args()
    command = parsed(RunExperiment, "experiment run", words)
    with command.opened() as runner:
        print(draw_strips(runner, rows_named(runner.table, command.rows), options.count))


def draw_strips(runner: TableRunner, rows: Sequence[Row], count: int) -> Path:
    """Draws OUTPUT/TABLE_strips.svg: prompts spread over the test split; returns the file.

    Args:
        runner: The table, whose rows are trained where they are not yet.
        rows: Rows that generate motions; others are left out.
        count: Number of prompts.

    Raises:
        InputError: No row generates, or there are not so many different captions.
    """
    rows = [row for row in rows if row.motions == "generated"]
    if not rows:
        raise InputError(f"no row of {runner.table.name} generates motions; name some by --rows")
    candidates = [Generated(runner.pipeline(row), row=row.name) for row in rows]
    test_set = build_test_set(candidates, runner.work.dataset, None, runner.protocol)
    first = test_set.replication(0)
    task = candidates[0].card.condition
    captions = [prompt.text(task) for prompt in first.prompts]
    numbers = spread(captions, count)
    if task.name == "action":  # three of a label, as in the paper's figure
        same = [[n for n, text in enumerate(captions) if text == captions[k]] for k in numbers]
        numbers = [places[take % len(places)] for places in same for take in range(TAKES)]
    prompts = [first.prompts[number] for number in numbers]
    data = runner.work.dataset.representation
    columns = {REAL: [data.decode(first.features[number]) for number in numbers]}
    for row, candidate in zip(rows, candidates, strict=True):
        sampling = candidate.card.sampling.but(row.steps, row.guidance, row.sampler)
        made = replace(candidate, sampling=sampling).generate(prompts, range(len(prompts)))
        columns[row.title] = [data.decode(features) for features in made]
    path = runner.work.folder / f"{runner.table.name}_strips.svg"
    motions = {
        title: [Motion(joints, data.fps, data.skeleton) for joints in column]
        for title, column in columns.items()
    }
    with atomic_file(path) as temporary:
        temporary.write_text(sheet([captions[number] for number in numbers], motions), "utf-8")
    return path


def spread(captions: Sequence[str], count: int) -> list[int]:
    """Returns the numbers of `count` different captions, evenly spread over all.

    Raises:
        InputError: There are fewer, or none is asked for.
    """
    different = [caption for caption in dict.fromkeys(captions) if caption]
    firsts = [captions.index(caption) for caption in different]
    if not 1 <= count <= len(firsts):
        raise InputError(f"{count} prompts: expected 1 to {len(firsts)}, the different captions")
    return [firsts[index * len(firsts) // count] for index in range(count)]


def sheet(captions: Sequence[str], columns: Mapping[str, Sequence[Motion]]) -> str:
    """Returns the SVG of motions by column heading, each with one motion per caption."""
    width, line = _WIDTH * len(columns), _HEIGHT + _BAND
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} '
        f'{_BAND + line * len(captions)}"><style>{_STYLE}</style>'
        f'<rect width="100%" height="100%" fill="#fff"/>'
    ]
    for number, (title, motions) in enumerate(columns.items()):
        left = number * _WIDTH
        parts.append(f'<text class="h" x="{left + 8}" y="14">{escape(title)}</text>')
        for place, motion in enumerate(motions):
            floor = _BAND + (place + 1) * line - 8
            parts.append(f'<path class="f" d="M{left + 6} {floor}h{_WIDTH - 12}"/>')
            parts.append(figures(motion, left, floor))
    for place, caption in enumerate(captions):
        parts.append(f'<text x="8" y="{_BAND + place * line + 13}">{escape(caption)}</text>')
    return "\n".join([*parts, "</svg>", ""])


def figures(motion: Motion, left: float, floor: float) -> str:
    """Returns the stick figures of a cell as SVG paths, one for each side of all bodies."""
    frames = np.linspace(0, len(motion) - 1, FIGURES).round().astype(int)
    joints = motion.joints[frames].astype(np.float64)
    azimuth = half_front(motion)
    across = (joints - joints[:, :1]) @ np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
    spots = left + (np.arange(FIGURES)[:, None] + 0.5) * _WIDTH / FIGURES
    x, y = spots + _METER * across, floor - _METER * (joints[..., 1] - motion.joints[..., 1].min())
    lines: dict[str, list[str]] = {"m": [], "l": [], "r": []}
    for joint, (name, parent) in enumerate(
        zip(motion.skeleton.names, motion.skeleton.parents, strict=True)
    ):
        if parent >= 0:
            side = {"left": "l", "right": "r"}.get(name.partition("_")[0], "m")
            lines[side] += [
                f"M{x[n, parent]:.1f} {y[n, parent]:.1f}L{x[n, joint]:.1f} {y[n, joint]:.1f}"
                for n in range(FIGURES)
            ]
    return "".join(f'<path class="{side}" d="{"".join(drawn)}"/>' for side, drawn in lines.items())


if __name__ == "__main__":
    main()
