"""`latentmotion convert evaluator FILE -o FOLDER`: official evaluators become evaluator folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.errors import InputError, MissingExtraError


@dataclass(frozen=True)
class ConvertEvaluator:
    """Turn a file of the authors' evaluation into an evaluator folder.

    What the file holds is told by its names: HumanAct12's GRU (humanact12_gru.tar) or UESTC's graph
    network (uestc_rot6d_stgcn.tar). The file is opened without running any code inside it.
    """

    file: tyro.conf.Positional[Path]
    """The file."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """The evaluator folder to write."""
    labels: Path | None = None
    """Text file with the actions in the order of the logits, one a line, e.g. UESTC's
    action_classes.txt; HumanAct12's are known."""

    def run(self) -> None:
        """Converts, and says what it was.

        Raises:
            InputError: The file holds no evaluator that is known.
        """
        try:
            from latentmotion.upstream.action_classifiers import (
                convert_action_classifier,
                weights_of,
            )
            from latentmotion.upstream.reading import read_content
        except ImportError as error:
            raise MissingExtraError("converting an evaluator", "PyTorch", "train") from error
        weights = weights_of(read_content(self.file))
        if weights is None:
            raise InputError(
                f"{self.file} holds no evaluator that is known; expected humanact12_gru.tar or "
                "uestc_rot6d_stgcn.tar"
            )
        about = convert_action_classifier(weights, self.file, self.output, self._labels())
        kind = type(about.network).__name__.removesuffix("Config")
        print(f"wrote {self.output}: {kind}, {len(about.labels)} actions")

    def _labels(self) -> list[str] | None:
        if self.labels is None:
            return None
        try:
            text = self.labels.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot read labels from {self.labels}: {error}") from error
        return [line.strip() for line in text.splitlines() if line.strip()]
