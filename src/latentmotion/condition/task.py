"""Tasks: what steers a motion, and all that follows from it in training, generation, evaluation.

Each is one class, whose fields are what a model's card says of its condition. Adding a task means
adding a class to `TASKS`; nothing else tells tasks apart.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from latentmotion.condition.action import ActionCondition
from latentmotion.condition.interface import Condition, TextEncoder
from latentmotion.condition.sentence import SentenceCondition, SentenceReading
from latentmotion.condition.unconditional import Unconditional
from latentmotion.errors import InputError

TaskName = Literal["text", "action", "unconditional"]
"""What a model is conditioned on, as cards, experiments and the command line name it."""


@dataclass(frozen=True)
class TrainingCondition:
    """What training has at hand to condition a model on."""

    source: str
    """Where the data is."""
    labels: tuple[str, ...]
    """Labels of the training clips."""
    encoder: Callable[[], TextEncoder]
    """Returns the text encoder that the user passed, or raises an error."""
    reading: SentenceReading
    """What the denoiser sees of sentences."""


class Task(ABC):
    """What every task answers."""

    name: ClassVar[TaskName]
    """As cards and experiments name it."""
    reads_text: ClassVar[bool] = False
    """Whether prompts are sentences, which need a text encoder."""
    prompted: ClassVar[bool] = True
    """Whether the model is asked anything, so that its answers can match a prompt."""
    whole_clips: ClassVar[bool] = True
    """Whether a clip is shown as a whole; else parts with sentences of their own are items."""
    asks_for: ClassVar[str]
    """Which clips an evaluation can ask for, in words."""

    @classmethod
    @abstractmethod
    def of_training(cls, given: TrainingCondition) -> Task:
        """Returns the task as training has it.

        Raises:
            InputError: There is no text encoder for sentences, or no label for actions.
        """

    @abstractmethod
    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> Condition:
        """Returns what turns prompts into words.

        Args:
            width: Numbers per word that the denoiser expects.
            encoder: Loads the text encoder; called where prompts are sentences.
        """

    @abstractmethod
    def check_prompt(self, prompt: str, model: str) -> None:
        """Raises InputError where the prompt is of another kind than the model named takes."""

    @abstractmethod
    def no_prompt(self, model: str) -> InputError:
        """Returns what a user is told who gave no prompt to the model named."""

    @abstractmethod
    def prompts(self, captions: tuple[str, ...], label: str | None) -> tuple[str, ...] | None:
        """Returns the prompts of a training item; none stand for no condition.

        Args:
            captions: Its sentences.
            label: The label of its clip.

        Returns:
            None where the item can't be learned.
        """

    @abstractmethod
    def question(self, caption: str, label: str | None) -> str:
        """Returns the prompt of an evaluation for a clip of this caption and label."""

    @property
    @abstractmethod
    def condition_width(self) -> int:
        """Numbers per word that a denoiser of this task sees."""

    @property
    def parents(self) -> dict[str, str]:
        """What a model of this task builds on, by name."""
        return {}

    @property
    def text_encoder(self) -> str | None:
        """Name of the text encoder, where there is one."""
        return None

    @property
    def known_prompts(self) -> tuple[str, ...]:
        """All prompts that there are, where they can be counted."""
        return ()


@dataclass(frozen=True)
class TextTask(Task):
    """Sentences, read by a text encoder."""

    name = "text"
    reads_text = True
    whole_clips = False
    asks_for = "with captions"

    encoder: str | None = None
    """Name of the text encoder; null where the second stage is not trained yet."""
    width: int = 0
    """Numbers per word of the encoder."""
    reading: SentenceReading = field(default_factory=SentenceReading)
    """What the denoiser sees of sentences."""

    @classmethod
    def of_training(cls, given: TrainingCondition) -> TextTask:
        """Returns the task with the text encoder that was passed."""
        encoder = given.encoder()
        return cls(encoder.name, encoder.width, given.reading)

    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> SentenceCondition:
        """Returns the text encoder as a condition."""
        return SentenceCondition(encoder(), self.reading)

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
        """Returns an example."""
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
        """The encoder's."""
        return self.width

    @property
    def parents(self) -> dict[str, str]:
        """The text encoder."""
        return {"text": self.encoder} if self.encoder else {}

    @property
    def text_encoder(self) -> str | None:
        """Name of the text encoder."""
        return self.encoder


@dataclass(frozen=True)
class ActionTask(Task):
    """Labels of actions. One that only held-out clips have cannot be learned."""

    name = "action"
    asks_for = "with a label"

    labels: tuple[str, ...] = ()
    """Labels that the model knows, in the order of the denoiser's table."""

    @classmethod
    def of_training(cls, given: TrainingCondition) -> ActionTask:
        """Returns the task with the labels of the data."""
        if not given.labels:
            raise InputError(
                f"no training clip of {given.source} has an action label, which task=action needs; "
                "use data with labels, or task=text or task=unconditional"
            )
        return cls(given.labels)

    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> ActionCondition:
        """Returns the labels as unit vectors."""
        return ActionCondition(self.labels)

    def check_prompt(self, prompt: str, model: str) -> None:
        """Refuses empty labels; whether a label is known, the condition tells."""
        if not prompt.strip():
            known = ", ".join(self.labels)
            raise InputError(f"model {model!r} takes an action label; known are {known}")

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
        """As many as labels."""
        return len(self.labels)

    @property
    def known_prompts(self) -> tuple[str, ...]:
        """The labels."""
        return self.labels


@dataclass(frozen=True)
class UnconditionalTask(Task):
    """Nothing: the model moves as it likes."""

    name = "unconditional"
    prompted = False
    asks_for = "of any kind"

    @classmethod
    def of_training(cls, given: TrainingCondition) -> UnconditionalTask:
        """Returns the task."""
        return cls()

    def condition(self, width: int, encoder: Callable[[], TextEncoder]) -> Unconditional:
        """Returns no words."""
        return Unconditional(width)

    def check_prompt(self, prompt: str, model: str) -> None:
        """Refuses prompts."""
        if prompt:
            raise InputError(
                f"model {model!r} makes motions of its own choice and takes no prompt; "
                f"leave {prompt!r} out"
            )

    def no_prompt(self, model: str) -> InputError:
        """Returns the empty prompt, which stands for none."""
        return InputError(f'model {model!r} takes no prompt; pass ""')

    def prompts(self, captions: tuple[str, ...], label: str | None) -> tuple[str, ...]:
        """Returns none."""
        return ()

    def question(self, caption: str, label: str | None) -> str:
        """Returns the empty prompt."""
        return ""

    @property
    def condition_width(self) -> int:
        """One, though there is no word."""
        return 1


TASKS: dict[TaskName, type[TextTask | ActionTask | UnconditionalTask]] = {
    "text": TextTask,
    "action": ActionTask,
    "unconditional": UnconditionalTask,
}
"""Every task by its name."""
