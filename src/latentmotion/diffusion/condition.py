"""Conditions: a sentence, a label or nothing becomes words, each a vector.

Two steps, so that embeddings can be kept on disk in training: a text encoder turns sentences into
a `TextEmbedding`; from it, or from a label, a `Conditioning` is made, which is all a denoiser sees.
Every implementation is checked (tests/diffusion/test_conditions.py) for this:
the order in the batch does not matter, neither does the company a sentence is in, and the null
condition depends on no input.

Tasks are the kinds of condition, and what follows from each in training, generation and
evaluation. Each is one class, whose fields are what a model's card says of its condition. Adding a
task means adding a class to `TASKS`; nothing else tells tasks apart.
"""

from __future__ import annotations

import difflib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from latentmotion.arrays import array_namespace
from latentmotion.errors import InputError


@dataclass(frozen=True)
class Conditioning:
    """The condition of a batch of motions, NumPy or torch."""

    # One vector per word; a pooled sentence or a label is one word.
    tokens: Float[Any, "batch words width"]
    mask: Bool[Any, "batch words"]  # True on real words.


@dataclass(frozen=True)
class TextEmbedding:
    """Embeddings of a batch of sentences, NumPy or torch."""

    pooled: Float[Any, "batch width"]  # One vector per sentence.
    # One vector per word piece, zero where there is none; CLIP's may be of another width.
    words: Float[Any, "batch words _"]
    mask: Bool[Any, "batch words"]  # True on real word pieces.


@runtime_checkable
class Condition(Protocol):
    """Sentences, labels or nothing to what a denoiser sees."""

    def __call__(self, inputs: Sequence[Any]) -> Conditioning:
        """Returns the condition of each input.

        Raises:
            InputError: An input is not of this condition's kind.
        """
        ...

    def null(self, count: int) -> Conditioning:
        """Returns `count` rows of no condition, the same whatever the inputs are."""
        ...


@runtime_checkable
class TextEncoder(Protocol):
    """Sentences to embeddings. The empty sentence is allowed: it is the null condition's."""

    @property
    def name(self) -> str:
        """What distinguishes this encoder's embeddings from any other's."""
        ...

    @property
    def width(self) -> int:
        """Numbers per vector."""
        ...

    def __call__(self, sentences: Sequence[str]) -> TextEmbedding:
        """Returns the embeddings of at least one sentence, float32.

        Raises:
            InputError: There is no sentence.
        """
        ...


def stack(rows: Sequence[TextEmbedding]) -> TextEmbedding:
    """Returns several embeddings as one batch, words filled with zeros to the longest."""
    if len(rows) == 1:
        return rows[0]
    longest = max(row.mask.shape[1] for row in rows)
    count = sum(len(row.mask) for row in rows)
    words = np.zeros((count, longest, rows[0].words.shape[2]), rows[0].words.dtype)
    mask, at = np.zeros((count, longest), bool), 0
    for row in rows:
        part = slice(at, at := at + len(row.mask)), slice(row.mask.shape[1])
        words[part], mask[part] = row.words, row.mask
    return TextEmbedding(np.concatenate([row.pooled for row in rows]), words, mask)


# Name of a model's kind of condition in cards, experiments and on the command line.
TaskName = Literal["text", "action", "unconditional"]


@dataclass(frozen=True)
class TextConditioning:
    """What a denoiser sees of an embedded sentence.

    Pooled embeddings of "left" and "right" differ by a hundredth; words tell them apart.

    Raises:
        InputError: It would see nothing.
    """

    pooled: bool = True  # Whether the first token is the pooled sentence.
    words: int = 0  # Maximum number of word pieces that follow.
    # What stands for no sentence: the empty one as in MLD, or zeros as in MDM.
    null: Literal["empty", "zeros"] = "empty"

    def __post_init__(self) -> None:
        if not self.pooled and self.words < 1:
            raise InputError("a condition of sentences needs pooled=true or words of at least 1")

    def __call__(self, embedding: TextEmbedding) -> Conditioning:
        """Returns the tokens of a batch of sentences."""
        words, mask = embedding.words[:, : self.words], embedding.mask[:, : self.words]
        if not self.pooled:
            return Conditioning(words, mask)
        xp = array_namespace(embedding.pooled)
        pooled, always = (
            embedding.pooled[:, None],
            xp.ones_like(embedding.pooled[:, :1], dtype=xp.bool),
        )
        if not self.words:  # CLIP's words may be of another width than its sentences
            return Conditioning(pooled, always)
        tokens = xp.concat([pooled, words], axis=1)
        return Conditioning(tokens, xp.concat([always, mask], axis=1))


@dataclass(frozen=True)
class SentenceCondition:
    """A text encoder as a condition."""

    encoder: TextEncoder  # Sentences to embeddings.

    # Their embeddings, as the denoiser reads them.
    conditioning: TextConditioning = field(default_factory=TextConditioning)

    def __call__(self, inputs: Sequence[str]) -> Conditioning:
        """Returns the condition of each sentence.

        Raises:
            InputError: There is no sentence.
        """
        return self.conditioning(self.encoder(inputs))

    def null(self, count: int) -> Conditioning:
        """Returns the empty sentence `count` times (MLD's unconditional prompt), or its zeros."""
        empty = self([""] * count)
        if self.conditioning.null == "empty":
            return empty
        xp = array_namespace(empty.tokens)
        return Conditioning(xp.zeros_like(empty.tokens), empty.mask)


@dataclass(frozen=True)
class ActionCondition:
    """Action labels as a condition: label k of n is the k-th unit vector, null is zero.

    A denoiser's linear map without bias (`condition_projection="table"`) turns it into row k of a
    learned table, and null into zero, as MLD's action embedding with its masked labels.
    """

    labels: tuple[str, ...]  # Names, in the order of the table's rows.

    def __call__(self, inputs: Sequence[str]) -> Conditioning:
        """Returns one unit vector per label.

        Raises:
            InputError: A label is unknown.
        """
        for label in inputs:
            if label in self.labels:
                continue
            near = difflib.get_close_matches(label, self.labels, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise InputError(f"unknown action {label!r}; {hint}known are {', '.join(self.labels)}")
        rows = np.eye(len(self.labels), dtype=np.float32)[[self.labels.index(n) for n in inputs]]
        return Conditioning(rows[:, None], np.ones((len(inputs), 1), dtype=bool))

    def null(self, count: int) -> Conditioning:
        """Returns `count` zero vectors."""
        tokens = np.zeros((count, 1, len(self.labels)), np.float32)
        return Conditioning(tokens, np.ones((count, 1), dtype=bool))


@dataclass(frozen=True)
class Unconditional:
    """No condition: no words at all, for models that learned motion alone."""

    width: int  # Numbers per word that the denoiser expects.

    def __call__(self, inputs: Sequence[object]) -> Conditioning:
        """Returns no words for each input."""
        return self.null(len(inputs))

    def null(self, count: int) -> Conditioning:
        """Returns no words, `count` times."""
        return Conditioning(
            np.zeros((count, 0, self.width), np.float32), np.zeros((count, 0), dtype=bool)
        )


@dataclass(frozen=True)
class TrainingCondition:
    """Inputs from which a task builds the condition that a model is trained with."""

    source: str  # Where the data is.
    labels: tuple[str, ...]  # Labels of the training clips.
    # Returns the text encoder that the user passed, or raises an error.
    encoder: Callable[[], TextEncoder]
    conditioning: TextConditioning  # Sentence embeddings that the denoiser reads.


class Task(ABC):
    """The kind of prompt that a model is conditioned on; what is not overridden means: none."""

    name: ClassVar[TaskName]  # Name of the task in cards and experiments.
    reads_text: ClassVar[bool] = False  # Whether prompts are sentences, which need a text encoder.
    # Whether motions have prompts, so that their match with the prompt can be measured.
    prompted: ClassVar[bool] = True
    # Whether a clip is shown as a whole; else parts with sentences of their own are items.
    whole_clips: ClassVar[bool] = True
    asks_for: ClassVar[str]  # Clips that an evaluation can use, as a phrase for messages.
    encoder: str | None = None  # Name of the text encoder, where there is one.
    labels: tuple[str, ...] = ()  # All possible prompts, where their number is finite.

    @classmethod
    def of_training(cls: type[AnyTask], training: TrainingCondition) -> AnyTask:
        """Returns the task as training has it.

        Raises:
            InputError: There is no text encoder for sentences, or no label for actions.
        """
        return cls()

    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> Condition:
        """Returns what turns prompts into words.

        Args:
            width: Numbers per word that the denoiser expects.
            encoder: Loads the text encoder; called where prompts are sentences.
        """
        return Unconditional(width)

    @abstractmethod
    def check_prompt(self, prompt: str, model: str) -> None:
        """Raises InputError where the prompt is of another kind than the model named takes."""

    @abstractmethod
    def no_prompt(self, model: str) -> InputError:
        """Returns the error for a missing prompt of the model named."""

    def prompts(self, captions: tuple[str, ...], label: str | None) -> tuple[str, ...] | None:
        """Returns the prompts of a training item; none stand for no condition.

        Args:
            captions: Its sentences.
            label: The label of its clip.

        Returns:
            None where the item can't be learned.
        """
        return ()

    def question(self, caption: str, label: str | None) -> str:
        """Returns the prompt of an evaluation for a clip of this caption and label."""
        return ""

    @property
    def condition_width(self) -> int:
        """Numbers per word that a denoiser of this task sees; no words have a width, too."""
        return 1

    @property
    def parents(self) -> dict[str, str]:
        """Names of the models that this one depends on, which its run folder records."""
        return {"text": self.encoder} if self.encoder else {}


AnyTask = TypeVar("AnyTask", bound=Task)


@dataclass(frozen=True)
class TextTask(Task):
    """Sentences, read by a text encoder."""

    name = "text"
    reads_text = True
    whole_clips = False
    asks_for = "with captions"

    # Name of the text encoder; null where the second stage is not trained yet.
    encoder: str | None = None
    width: int = 0  # Numbers per word of the encoder.
    # Sentence embeddings that the denoiser reads.
    conditioning: TextConditioning = field(default_factory=TextConditioning)

    @classmethod
    def of_training(cls, training: TrainingCondition) -> TextTask:
        """Returns the task with the text encoder that was passed."""
        encoder = training.encoder()
        return cls(encoder.name, encoder.width, training.conditioning)

    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> SentenceCondition:
        """Returns the text encoder as a condition."""
        return SentenceCondition(encoder(), self.conditioning)

    def check_prompt(self, prompt: str, model: str) -> None:
        """Refuses empty sentences and what looks like a label."""
        if not prompt.strip():
            raise InputError("the sentence is empty; say what the person does")
        if re.fullmatch(r"\w*([a-z][A-Z]|_|\d)\w*", prompt):
            raise InputError(
                f"{prompt!r} looks like a label; model {model!r} takes sentences, "
                'e.g. "a person kicks with the left leg"'
            )

    def no_prompt(self, model: str) -> InputError:
        """Returns the error for a missing sentence, with an example."""
        example = 'latentmotion generate "a person walks" -o walk.bvh'
        return InputError(f"no sentence given; name it before -o: {example}")

    def prompts(self, captions: tuple[str, ...], label: str | None) -> tuple[str, ...]:
        """Returns the sentences."""
        return captions

    def question(self, caption: str, label: str | None) -> str:
        """Returns the sentence."""
        return caption

    @property
    def condition_width(self) -> int:
        """Width of the text encoder's vectors."""
        return self.width


@dataclass(frozen=True)
class ActionTask(Task):
    """Labels of actions. One that only held-out clips have cannot be learned."""

    name = "action"
    asks_for = "with a label"

    # Labels that the model knows, in the order of the denoiser's table.
    labels: tuple[str, ...] = ()

    @classmethod
    def of_training(cls, training: TrainingCondition) -> ActionTask:
        """Returns the task with the labels of the data."""
        if not training.labels:
            raise InputError(
                f"no training clip of {training.source} has an action label, which task=action "
                "needs; use data with labels, or task=text or task=unconditional"
            )
        return cls(training.labels)

    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> ActionCondition:
        """Returns the labels as unit vectors."""
        return ActionCondition(self.labels)

    def check_prompt(self, prompt: str, model: str) -> None:
        """Refuses empty labels; the condition itself refuses unknown ones."""
        if not prompt.strip():
            labels = ", ".join(self.labels)
            raise InputError(f"model {model!r} takes an action label; known are {labels}")

    def no_prompt(self, model: str) -> InputError:
        """Returns the labels."""
        return InputError(f"no action given; model {model!r} knows {', '.join(self.labels)}")

    def prompts(self, captions: tuple[str, ...], label: str | None) -> tuple[str, ...] | None:
        """Returns the label."""
        if label is None:
            return ()
        return (label,) if label in self.labels else None

    def question(self, caption: str, label: str | None) -> str:
        """Returns the label."""
        return label or ""

    @property
    def condition_width(self) -> int:
        """One number per label, since a label is a one-hot vector."""
        return len(self.labels)


@dataclass(frozen=True)
class UnconditionalTask(Task):
    """No condition: the model draws from the distribution of all motions."""

    name = "unconditional"
    prompted = False
    asks_for = "of any kind"

    def check_prompt(self, prompt: str, model: str) -> None:
        """Refuses prompts."""
        if prompt:
            raise InputError(
                f"model {model!r} makes motions of its own choice and takes no prompt; "
                f"leave {prompt!r} out"
            )

    def no_prompt(self, model: str) -> InputError:
        """Returns the error for a missing prompt: the empty one stands for none."""
        return InputError(f'model {model!r} takes no prompt; pass ""')


# Every task by its name.
TASKS: dict[TaskName, type[TextTask | ActionTask | UnconditionalTask]] = {
    "text": TextTask,
    "action": ActionTask,
    "unconditional": UnconditionalTask,
}
