"""What a run says of itself: progress with time left, journal.jsonl and TensorBoard's events."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from latentmotion.errors import MissingExtraError
from latentmotion.storage.files import atomic_file

NAME = "journal.jsonl"


class Journal:
    """Writes figures of a run; lines of steps that a kill undid are removed on opening.

    Args:
        folder: The run folder.
        steps: Steps of the whole run, for the time left.
        done: Steps that the snapshot holds.
    """

    def __init__(self, folder: Path, steps: int, done: int = 0) -> None:
        self._steps = steps
        _keep_until(folder / NAME, done)
        self._file = (folder / NAME).open("a", encoding="utf-8")
        self._board = _summary_writer(folder / "tensorboard", done)

    def close(self) -> None:
        """Ends the files."""
        self._file.close()
        self._board.close()

    def write(self, step: int, kind: str, figures: Mapping[str, float]) -> None:
        """Appends figures (losses, rates, millimeters) of `kind` "train" or "validation"."""
        rounded = {name: float(f"{value:.6g}") for name, value in figures.items()}
        self._file.write(json.dumps({"step": step, "kind": kind, **rounded}) + "\n")
        self._file.flush()
        for name, value in rounded.items():
            self._board.add_scalar(f"{kind}/{name}", value, step)

    def show(self, step: int, kind: str, figures: Mapping[str, float], pace: float) -> None:
        """Prints a line: step, figures and, from the pace in seconds a step, the time left."""
        left = readable_time((self._steps - step) * pace)
        values = "  ".join(f"{name} {value:.4g}" for name, value in figures.items())
        line = f"{step}/{self._steps} {kind}  {values}  ({pace:.3f} s a step, {left} left)"
        print(line, file=sys.stderr, flush=True)


def readable_time(seconds: float) -> str:
    """Writes a duration as 2 h 05 min, 3 min 20 s or 12 s."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def read_journal(folder: str | Path) -> list[dict[str, Any]]:
    """Returns the lines of a run's journal; a last line cut short by a kill is left out."""
    path = Path(folder) / NAME
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]


def _keep_until(path: Path, step: int) -> None:
    lines = [line for line in read_journal(path.parent) if line["step"] <= step]
    with atomic_file(path) as temporary:
        text = "".join(json.dumps(line) + "\n" for line in lines)
        temporary.write_text(text, encoding="utf-8")


def _summary_writer(folder: Path, done: int) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise MissingExtraError("the journal of a training run", "tensorboard", "train") from error
    return SummaryWriter(str(folder), purge_step=done + 1)
