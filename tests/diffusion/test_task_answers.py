"""What each task answers to prompts, captions and labels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from latentmotion.diffusion.condition import (
    TASKS,
    ActionCondition,
    ActionTask,
    Condition,
    SentenceCondition,
    Task,
    TextConditioning,
    TextEmbedding,
    TextEncoder,
    TextTask,
    TrainingCondition,
    Unconditional,
    UnconditionalTask,
    stack,
)
from latentmotion.errors import InputError

TEXT, NOTHING = TextTask("letters", 5), UnconditionalTask()
ACTION = ActionTask(("kick", "walk"))


class Encoder:
    """A text encoder of three words for any sentence."""

    name, width = "letters", 5

    def __call__(self, sentences: list[str]) -> TextEmbedding:
        count = len(sentences)
        words = np.ones((count, 3, 5), np.float32)
        return TextEmbedding(words[:, 0], words, np.ones((count, 3), bool))


def no_encoder() -> TextEncoder:
    raise InputError("needs a text encoder")


@pytest.mark.parametrize("name", TASKS)
def test_tasks_are_found_by_their_names(name) -> None:
    assert TASKS[name].name == name


@pytest.mark.parametrize(
    ("task", "reads", "prompted", "whole", "width", "known", "parents"),
    [
        (TEXT, True, True, False, 5, (), {"text": "letters"}),
        (TextTask(), True, True, False, 0, (), {}),
        (ACTION, False, True, True, 2, ("kick", "walk"), {}),
        (NOTHING, False, False, True, 1, (), {}),
    ],
)
def test_what_follows_from_a_task(
    task: Task, reads: bool, prompted: bool, whole: bool, width: int, known: tuple, parents: dict
) -> None:
    assert (task.reads_text, task.prompted, task.whole_clips) == (reads, prompted, whole)
    assert (task.condition_width, task.labels, task.parents) == (width, known, parents)
    assert task.encoder == parents.get("text")


@pytest.mark.parametrize(
    ("task", "captions", "label", "expected"),
    [
        (TEXT, ("a", "b"), "kick", ("a", "b")),
        (TEXT, (), "kick", ()),
        (ACTION, ("a",), "walk", ("walk",)),
        (ACTION, ("a",), None, ()),
        (ACTION, ("a",), "fly", None),
        (NOTHING, ("a",), "walk", ()),
    ],
)
def test_prompts_of_a_training_item(
    task: Task, captions: tuple[str, ...], label: str | None, expected: tuple[str, ...] | None
) -> None:
    assert task.prompts(captions, label) == expected


@pytest.mark.parametrize(
    ("task", "good"),
    [
        (TEXT, ["a person walks", "walk", "A", "two 2", "jump!", "OK"]),
        (ACTION, ["kick", "anything"]),
        (NOTHING, [""]),
    ],
)
def test_prompts_of_the_right_kind(task: Task, good: list[str]) -> None:
    for prompt in good:
        task.check_prompt(prompt, "mine")


@pytest.mark.parametrize(
    ("task", "prompt", "message"),
    [
        (TEXT, "", "the sentence is empty"),
        (TEXT, " \n", "the sentence is empty"),
        (TEXT, "kickLeft", r"'kickLeft' looks like a label; model 'mine' takes sentences"),
        (TEXT, "turn_left", "looks like a label"),
        (TEXT, "squat1Reps", "looks like a label"),
        (ACTION, " ", "model 'mine' takes an action label; known are kick, walk"),
        (NOTHING, "walk", "model 'mine' makes motions of its own choice .* leave 'walk' out"),
    ],
)
def test_prompts_of_another_kind(task: Task, prompt: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        task.check_prompt(prompt, "mine")


@pytest.mark.parametrize(
    ("task", "told"),
    [
        (TEXT, 'latentmotion generate "a person walks" -o walk.bvh'),
        (ACTION, "model 'mine' knows kick, walk"),
        (NOTHING, "model 'mine' takes no prompt; pass \"\""),
    ],
)
def test_who_gave_no_prompt_is_told_what_to_give(task: Task, told: str) -> None:
    assert told in str(task.no_prompt("mine"))


@pytest.mark.parametrize(
    ("kind", "encoder", "labels", "expected"),
    [
        (TextTask, Encoder, (), TextTask("letters", 5, TextConditioning(words=2))),
        (ActionTask, no_encoder, ("kick", "walk"), ACTION),
        (UnconditionalTask, no_encoder, (), NOTHING),
    ],
)
def test_tasks_of_training_take_what_they_need(
    kind: type[Task], encoder: Callable[[], TextEncoder], labels: tuple[str, ...], expected: Task
) -> None:
    given = TrainingCondition("my data", labels, encoder, TextConditioning(words=2))
    assert kind.of_training(given) == expected


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (TextTask, "needs a text encoder"),
        (ActionTask, "no training clip of my data has an action label"),
    ],
)
def test_tasks_of_training_miss_what_is_not_there(kind: type[Task], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kind.of_training(TrainingCondition("my data", (), no_encoder, TextConditioning()))


@pytest.mark.parametrize(
    ("task", "kind", "prompts", "shape"),
    [
        (TEXT, SentenceCondition, ["a", "b"], (2, 1, 5)),
        (TextTask("letters", 5, TextConditioning(words=2)), SentenceCondition, ["a"], (1, 3, 5)),
        (ACTION, ActionCondition, ["kick", "walk"], (2, 1, 2)),
        (NOTHING, Unconditional, ["", "", ""], (3, 0, 7)),
    ],
)
def test_conditions_have_the_shapes_of_their_task(
    task: Task, kind: type, prompts: list[str], shape: tuple[int, ...]
) -> None:
    condition: Condition = task.condition(7, Encoder)
    assert isinstance(condition, kind)
    assert condition(prompts).tokens.shape == shape
    assert condition.null(4).tokens.shape == (4, *shape[1:])


@pytest.mark.parametrize("label", ["kicks", "jump"])
def test_an_unknown_label_gets_the_nearest_or_all(label: str) -> None:
    hint = "did you mean 'kick'[?] " if label == "kicks" else ""
    with pytest.raises(
        InputError, match=rf"^unknown action '{label}'; {hint}known are kick, walk$"
    ):
        ActionCondition(ACTION.labels)(["walk", label])


def test_batches_of_other_lengths_are_filled_with_zeros() -> None:
    one, two = (
        TextEmbedding(
            np.full((1, 2), float(n)), np.full((1, n, 3), float(n)), np.ones((1, n), bool)
        )
        for n in (1, 2)
    )
    both = stack([two, one])
    assert both.words[:, :, 0].tolist() == [[2, 2], [1, 0]]
    assert both.mask.tolist() == [[True, True], [True, False]]
    assert both.pooled[:, 0].tolist() == [2, 1]
