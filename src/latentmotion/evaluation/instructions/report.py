"""The benchmark's report: a table by group, the prompts that fail, and all of it as JSON."""

from __future__ import annotations

import json
from pathlib import Path

from latentmotion.evaluation.instructions.benchmark import OVERALL, Benchmark
from latentmotion.storage.configuration import to_json
from latentmotion.storage.files import atomic_folder

REPORT_FILE = "instructions.json"
PAGE_FILE = "instructions.md"


def table(found: Benchmark) -> str:
    """Returns the figures as a Markdown table, a group a line."""
    head = ["group", "prompts", found.subject, "in some take", "real motions", "other prompts'"]
    lines = [_line(head), "|---" * len(head) + "|"]
    for group, share in found.model.items():
        real = found.real.get(group)
        lines.append(
            _line(
                [
                    f"**{group}**" if group == OVERALL else group,
                    str(share.prompts),
                    str(share),
                    f"{100 * share.ever:.0f} %",
                    f"{real}, {real.motions} claims" if real else "–",
                    f"{100 * found.chance[group].share:.0f} %",
                ]
            )
        )
    return "\n".join(lines)


def markdown(found: Benchmark) -> str:
    """Returns a page: the table, how it was measured, every prompt."""
    takes = len(found.outcomes[0].fulfilled)
    about = [f"{name}: {value}" for name, value in found.about.items()]
    return "\n\n".join(
        [
            f"# Instructions, version {found.version}: {found.subject}",
            table(found),
            f"Motions that do what the prompt says, of {takes} per prompt, with 95 % intervals "
            "(Wilson, takes of a prompt taken as dependent); prompts with a take that does; real "
            "motions whose captions claim the like; the checks on motions of other prompts.",
            "\n".join(f"* {line}" for line in about),
            "## Prompts",
            "\n".join(_prompts(found)),
        ]
    )


def write(found: Benchmark, folder: str | Path) -> None:
    """Writes `instructions.json` and `instructions.md` in place of what is there.

    Raises:
        InputError: The folder cannot be written, or holds something else.
    """
    with atomic_folder(folder, REPORT_FILE) as temporary:
        text = json.dumps(to_json(found), indent=1, ensure_ascii=False)
        (temporary / REPORT_FILE).write_text(text + "\n", encoding="utf-8")
        (temporary / PAGE_FILE).write_text(markdown(found) + "\n", encoding="utf-8")


def _prompts(found: Benchmark) -> list[str]:
    lines = [_line(["id", "prompt", "check", "fulfilled"]), "|---|---|---|---|"]
    for one in found.outcomes:
        done = f"{sum(one.fulfilled)} of {len(one.fulfilled)}"
        lines.append(_line([one.id, one.prompt, f"`{one.check}`", done]))
    return lines


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"
