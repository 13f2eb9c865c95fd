"""Report of the benchmark: a table by group, every prompt, and both as JSON."""

from __future__ import annotations

import json
from pathlib import Path

from latentmotion.instructions.benchmark import OVERALL, Benchmark
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import atomic_folder

REPORT_FILE = "instructions.json"
PAGE_FILE = "instructions.md"


def table(benchmark: Benchmark) -> str:
    """Returns the figures as a Markdown table, one line per group."""
    head = ["group", "prompts", benchmark.subject, "in some take", "real motions", "other prompts'"]
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
                ]
            )
        )
    return "\n".join(lines)


def markdown(benchmark: Benchmark) -> str:
    """Returns a page: the table, settings of the motions, every prompt."""
    takes = len(benchmark.outcomes[0].fulfilled)
    about = [f"{name}: {value}" for name, value in benchmark.about.items()]
    prompts = [_line(["id", "prompt", "check", "fulfilled"]), "|---|---|---|---|"]
    for one in benchmark.outcomes:
        fulfilled = f"{sum(one.fulfilled)} of {takes}"
        prompts.append(_line([one.id, one.prompt, f"`{one.check}`", fulfilled]))
    return "\n\n".join(
        [
            f"# Instructions, version {benchmark.version}: {benchmark.subject}",
            table(benchmark),
            f"Motions that do what the prompt says, of {takes} per prompt, with 95 % intervals "
            "(Wilson, takes of a prompt taken as dependent); prompts with a take that does; real "
            "motions whose captions claim the like; the checks on motions of other prompts.",
            "\n".join(f"* {line}" for line in about),
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
