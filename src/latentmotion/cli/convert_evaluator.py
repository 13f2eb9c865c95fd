"""`latentmotion convert evaluator FILE -o FOLDER`: official evaluators become evaluator folders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from latentmotion.errors import InputError, MissingExtraError
from latentmotion.storage.files import read_lines


@dataclass(frozen=True)
class ConvertEvaluator:
    """Turn a file of the authors' evaluation into an evaluator folder.

    What the file holds is told by its names: the T2M evaluator (finest.tar, or one of MLD's
    checkpoints; needs --statistics and --glove), HumanAct12's GRU (humanact12_gru.tar) or UESTC's
    graph network (uestc_rot6d_stgcn.tar). It is opened without running any code inside it.
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """The file."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """The evaluator folder to write."""
    statistics: Path | None = None
    """T2M evaluator: folder with mean.npy and std.npy (Comp_v6_KLD01/meta), or t2m_mean.npy ..."""
    glove: Path | None = None
    """T2M evaluator: folder of our_vab_data.npy, our_vab_words.pkl and our_vab_idx.pkl."""
    labels: Path | None = None
    """Action classifiers: text file with the actions in the order of the logits, one a line, e.g.
    UESTC's action_classes.txt; HumanAct12's are known."""

    def run(self) -> None:
        """Converts, and says what it was.

        Raises:
            InputError: Something that the file needs beside it is not given.
        """
        try:
            from latentmotion.upstream.action_classifiers import weights_of
            from latentmotion.upstream.reading import read_content
        except ImportError as error:
            raise MissingExtraError("converting an evaluator", "PyTorch", "train") from error
        weights = weights_of(read_content(self.file))
        what = self._text_motion() if weights is None else self._actions(weights)
        print(f"wrote {self.output}: {what}")

    def _text_motion(self) -> str:
        from latentmotion.upstream.evaluators import (
            EvaluatorFiles,
            convert_evaluator,
            evaluator_weights,
        )

        evaluator_weights(self.file)
        if self.statistics is None or self.glove is None:
            raise InputError(
                f"{self.file} holds a T2M evaluator, which needs --statistics (its own mean.npy "
                "and std.npy) and --glove (its word vectors)"
            )
        convert_evaluator(EvaluatorFiles(self.file, self.statistics, self.glove), self.output)
        return "evaluator of text and motion"

    def _actions(self, weights: dict) -> str:
        from latentmotion.upstream.action_classifiers import convert_action_classifier

        about = convert_action_classifier(weights, self.file, self.output, self._labels())
        kind = type(about.network).__name__.removesuffix("Config")
        return f"{kind}, {len(about.labels)} actions"

    def _labels(self) -> list[str] | None:
        return read_lines(self.labels, "label") if self.labels else None
