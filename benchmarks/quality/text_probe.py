"""Whether a text encoder keeps the words that steer a motion apart: sides, counts, order and more.

    python -m benchmarks.quality.text_probe --model starter

For each distinction sentences are made of wordings and actors; a probe learns to tell the classes
on three quarters of the wordings and is asked on the others, four times in turn. `pooled` is
logistic regression on the sentence's vector, `mean` on the mean of its words' vectors, `attention`
four attention heads with learned places over the first 16 words, which is less than a layer of a
denoiser has, and `transformer` two layers of width 64 over them. Chance is one by the number of
classes. A probe of few sentences tells what is easy to read, not all that is there.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from benchmarks.harness.contest import table
from latentmotion.condition.interface import TextEncoder
from latentmotion.gpu.backend import text_encoder_named

WORDS = 16
"""Words that a denoiser sees."""

FOLDS = 4
"""Parts of the wordings, each held out once."""

ACTORS = ("a person", "a man", "the woman", "someone", "he", "the figure")

Fillings = tuple[tuple[str, ...], ...]
"""Per class, what fills {0}, {1}, … of a wording."""

SIDES: Fillings = (("left", "right"), ("right", "left"))
"""{0} is the side asked for, {1} the other."""

CONTRASTS: dict[str, tuple[Fillings, tuple[str, ...]]] = {
    "left, right": (
        SIDES,
        (
            "{who} raises the {0} hand",
            "{who} kicks with the {0} leg",
            "{who} waves with their {0} arm",
            "{who} turns {0}",
            "{who} walks in a circle to the {0}",
            "{who} takes a step to the {0}",
            "{who} punches with his {0} fist",
            "{who} lifts the {0} knee up high",
            "{who} looks over the {0} shoulder",
            "{who} stands on the {0} foot",
            "{who} jumps {0}wards",
            "{who} throws a ball {0} handed",
            "with the {0} hand {who} picks something up",
            "while walking, {who} veers off to the {0}",
            "{who} sidesteps {0} quickly",
            "using only the {0} foot, {who} hops",
        ),
    ),
    "which limb has which side": (
        SIDES,
        (
            "{who} raises the {0} hand and lifts the {1} foot",
            "{who} lifts the {1} foot and raises the {0} hand",
            "{who} waves the {0} arm while kicking with the {1} leg",
            "{who} kicks with the {1} leg while waving the {0} arm",
            "{who} stands on the {1} leg with the {0} hand up",
            "with the {0} hand up, {who} stands on the {1} leg",
            "{who} holds the {0} hand out, then steps with the {1} foot",
            "{who} steps with the {1} foot, then holds the {0} hand out",
            "{who} punches with the {0} arm and then kicks with the {1} leg",
            "{who} first kicks with the {1} leg, then punches with the {0} arm",
            "{who} touches the {1} knee with the {0} hand",
            "the {1} knee of {who} is touched by the {0} hand",
        ),
    ),
    "hand, leg": (
        (("hand", "arm", "fist"), ("leg", "foot", "knee")),
        (
            "{who} lifts the left {0}",
            "{who} raises the right {1}",
            "{who} swings the left {1} back and forth",
            "{who} strikes forward with the {2}",
            "{who} shakes the right {0}",
            "{who} moves the {1} in circles",
            "{who} stretches out the {1}",
            "{who} lowers the {0} slowly",
            "{who} hits the bag with the {2}",
            "the right {1} goes up",
            "{who} holds up one {0} for a while",
            "{who} balances, left {2} in the air",
        ),
    ),
    "clockwise, counterclockwise": (
        (("clockwise",), ("counterclockwise",)),
        (
            "{who} walks in a circle {0}",
            "{who} turns {0}",
            "{who} runs {0} around something",
            "{who} spins {0} twice",
            "{who} walks in a {0} circle",
            "{who} makes a {0} turn and stops",
            "{who} rotates the arms {0}",
            "{who} jogs along a {0} curve",
            "in {0} direction {who} steps around",
            "{who} goes around once, {0}",
            "{who} jumps and turns {0} in the air",
            "{who} dances {0} in circles",
        ),
    ),
    "one, two, three": (
        (
            ("once", "one", "a single", ""),
            ("twice", "two", "two", "s"),
            ("three times", "three", "three", "s"),
        ),
        (
            "{who} jumps {0}",
            "{who} kicks {0} with the left leg",
            "{who} takes {1} step{3} forward",
            "{who} claps {0}",
            "{who} does {1} squat{3}",
            "{who} throws {2} hook{3}",
            "{who} hops forward {0}",
            "{who} does {2} jumping jack{3}",
            "{who} waves {0} and stops",
            "{who} makes {2} small jump{3}",
            "{who} turns around {0}",
            "{1} step{3} back are taken by {who}",
        ),
    ),
    "forward, backward": (
        (("forward", "ahead", "forwards"), ("backward", "back", "backwards")),
        (
            "{who} walks {0}",
            "{who} jumps {2}",
            "{who} takes three steps {1}",
            "{who} runs {2} and stops",
            "{who} leans {0}",
            "{who} moves straight {1}",
            "{who} hops {0} on one leg",
            "{who} stumbles {2}",
            "slowly {who} steps {1}",
            "{who} jogs {2} for a bit",
            "{who} shuffles {0} a few feet",
            "{who} crawls {2} on the floor",
        ),
    ),
    "slow, fast": (
        (("slowly", "slow", "at a slow pace"), ("quickly", "fast", "at a fast pace")),
        (
            "{who} walks {0}",
            "{who} raises both arms {0}",
            "{who} walks forward {2}",
            "{who} makes a {1} turn to the left",
            "{who} {0} sits down",
            "{who} jogs {2} in a circle",
            "{who} throws a {1} punch",
            "{who} moves {0} to the right",
            "{who} bends down {0} and gets up",
            "{0} {who} kicks",
            "{who} does {1} jumping jacks",
            "{who} spins around, {2}",
        ),
    ),
    "order of two": ((("first",), ("second",)), ()),
}
"""Classes' fillings and wordings; those of order are made of actions."""

_OTHERS = (
    ("walks forward", "walking forward"),
    ("waves", "waving"),
    ("sits down", "sitting down"),
    ("kicks", "kicking"),
    ("turns around", "turning around"),
    ("bends down", "bending down"),
)

_ORDERS = (
    "{who} {a}, then {b}",
    "{who} {a} and then {b}",
    "{who} {a} and {b}",
    "{who} {a} before {b_ing}",
    "{who} {b} after {a_ing}",
    "after {a_ing}, {who} {b}",
    "before {b_ing}, {who} {a}",
    "first {who} {a}, afterwards {who} {b}",
    "{who} {a}. next, {who} {b}",
    "{who} {a}, stops, and finally {b}",
    "having finished {a_ing}, {who} {b}",
    "{who} starts by {a_ing} and ends by {b_ing}",
)


@dataclass(frozen=True)
class Question:
    """Sentences of one distinction."""

    sentences: tuple[str, ...]
    """The sentences."""
    labels: Int[np.ndarray, " sentences"]
    """Class of each."""
    wordings: Int[np.ndarray, " sentences"]
    """Number of each one's wording."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="starter", help="as for train denoiser --text-encoder")
    parser.add_argument("--only", nargs="*", default=[*CONTRASTS], choices=CONTRASTS)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    encoder = text_encoder_named(options.model)
    rows = []
    for name in options.only:
        question = _question(name)
        classes = 1 + int(question.labels.max())
        shares = _shares(encoder, question)
        figures = [f"{100 * share:.0f} %" for share in shares]
        rows.append([name, str(len(question.sentences)), f"{100 / classes:.0f} %", *figures])
    print(table(["distinction", "sentences", "chance", *PROBES], rows))


def _question(name: str) -> Question:
    fillings, wordings = CONTRASTS[name]
    if wordings:
        cases = product(enumerate(wordings), enumerate(fillings), ACTORS)
        rows = [(w.format(*fill, who=who), c, n) for (n, w), (c, fill), who in cases]
    else:
        orders = product(enumerate(_ORDERS), _OTHERS, range(2), ACTORS[:3])
        rows = [(_ordered(w, other, c, who), c, n) for (n, w), other, c, who in orders]
    sentences, labels, numbers = zip(*rows, strict=True)
    return Question(sentences, np.array(labels), np.array(numbers))


def _ordered(wording: str, other: tuple[str, str], place: int, who: str) -> str:
    """Returns a sentence in which a jump is done first (0) or second (1)."""
    jump = ("jumps", "jumping")
    (a, a_ing), (b, b_ing) = (jump, other) if place == 0 else (other, jump)
    return wording.format(who=who, a=a, b=b, a_ing=a_ing, b_ing=b_ing)


def _shares(encoder: TextEncoder, question: Question) -> list[float]:
    """Returns each probe's share of right answers on wordings that it did not learn on."""
    found = encoder(question.sentences)
    words, mask = found.words[:, :WORDS], found.mask[:, :WORDS]
    inputs = torch.tensor(found.pooled), torch.tensor(words), torch.tensor(mask)
    labels = torch.tensor(question.labels)
    folds = [torch.tensor(question.wordings % FOLDS == fold) for fold in range(FOLDS)]
    return [
        float(np.mean([_share(make, inputs, labels, held) for held in folds]))
        for make in PROBES.values()
    ]


def _share(
    make: Callable[[int, int], nn.Module],
    inputs: tuple[Tensor, Tensor, Tensor],
    labels: Int[Tensor, " sentences"],
    held: Bool[Tensor, " sentences"],
) -> float:
    torch.manual_seed(0)
    probe = make(inputs[0].shape[1], 1 + int(labels.max()))
    optimizer = torch.optim.AdamW(probe.parameters(), 3e-3, weight_decay=0.1)
    seen = [each[~held] for each in inputs]
    for _ in range(300):
        rows = torch.randint(int((~held).sum()), (64,))
        optimizer.zero_grad()
        batch = [each[rows] for each in seen]
        nn.functional.cross_entropy(probe(*batch), labels[~held][rows]).backward()
        optimizer.step()
    with torch.no_grad():
        answers = probe.eval()(*(each[held] for each in inputs)).argmax(1)
    return float((answers == labels[held]).float().mean())


class _Linear(nn.Module):
    def __init__(self, width: int, classes: int, pooled: bool) -> None:
        super().__init__()
        self.pooled = pooled
        self.norm, self.out = nn.BatchNorm1d(width, affine=False), nn.Linear(width, classes)

    def forward(
        self,
        pooled: Float[Tensor, "batch width"],
        words: Float[Tensor, "batch words width"],
        mask: Bool[Tensor, "batch words"],
    ) -> Float[Tensor, "batch classes"]:
        seen = mask[..., None].float()
        mean = (words * seen).sum(1) / seen.sum(1)
        return self.out(self.norm(pooled if self.pooled else mean))


class _Attention(nn.Module):
    """Four heads: each word's score and value from its vector and place."""

    def __init__(self, width: int, classes: int) -> None:
        super().__init__()
        self.places = nn.Parameter(torch.zeros(WORDS, width))
        self.norm = nn.LayerNorm(width)
        self.score, self.out = nn.Linear(width, 4), nn.Linear(4 * width, classes)

    def forward(
        self,
        pooled: Float[Tensor, "batch width"],
        words: Float[Tensor, "batch words width"],
        mask: Bool[Tensor, "batch words"],
    ) -> Float[Tensor, "batch classes"]:
        x = self.norm(words) + self.places[: words.shape[1]]
        scores = self.score(x).masked_fill(~mask[..., None], -1e4)
        return self.out(torch.einsum("bwh,bwc->bhc", scores.softmax(1), x).flatten(1))


class _Transformer(nn.Module):
    """Two layers over the words, as a denoiser reads them."""

    def __init__(self, width: int, classes: int) -> None:
        super().__init__()
        self.norm, self.into = nn.LayerNorm(width), nn.Linear(width, 64)
        self.places = nn.Parameter(0.1 * torch.randn(WORDS, 64))
        layer = nn.TransformerEncoderLayer(64, 4, 128, 0.1, "gelu", batch_first=True)
        self.layers = nn.TransformerEncoder(layer, 2, enable_nested_tensor=False)
        self.out = nn.Linear(64, classes)

    def forward(
        self,
        pooled: Float[Tensor, "batch width"],
        words: Float[Tensor, "batch words width"],
        mask: Bool[Tensor, "batch words"],
    ) -> Float[Tensor, "batch classes"]:
        x = self.into(self.norm(words)) + self.places[: words.shape[1]]
        x = self.layers(x, src_key_padding_mask=~mask) * mask[..., None]
        return self.out(x.sum(1) / mask.sum(1, keepdim=True))


PROBES: dict[str, Callable[[int, int], nn.Module]] = {
    "pooled": lambda width, classes: _Linear(width, classes, pooled=True),
    "mean": lambda width, classes: _Linear(width, classes, pooled=False),
    "attention": _Attention,
    "transformer": _Transformer,
}


if __name__ == "__main__":
    main()
