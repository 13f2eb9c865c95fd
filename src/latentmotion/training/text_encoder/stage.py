"""Distillation of a small text encoder from a large one (all-MiniLM-L6-v2).

The student is a BERT-like transformer, 3 layers of width 384 by default. It starts from some of the
teacher's layers and from the teacher's piece embeddings (`StudentRecipe.layers`). With the
teacher's sentence embeddings p (unit length) and piece states h, and the student's p̂ and ĥ:

    total = 20 · mean ‖p̂ − p‖²  +  mean ‖ĥ − h‖² / ‖h‖²  +  20 · mean (p̂ p̂ᵀ − p pᵀ)²

The last term is relational distillation (Park et al. 2019): it keeps the similarities between the
sentences of a batch. With several ranks each compares the sentences of its own share.

Captions are varied by other subjects, synonyms, imperatives, single clauses and typos. The student
learns the teacher's embedding of each variation, so a variation need not keep the meaning of its
caption; it only has to look like a prompt that a user may type.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import random
import re
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from tokenizers import Tokenizer

from latentmotion.errors import DataError
from latentmotion.export.package import export_student
from latentmotion.language.inflection import present_participle, third_person
from latentmotion.networks.pretrained_text import AT_ONCE, PretrainedTextEncoder
from latentmotion.networks.text_encoder import NetworkShape, StudentNetwork, teacher_state
from latentmotion.storage.files import atomic_file
from latentmotion.text.encoder import StudentTextEncoder, silent_of_unknown, split_words
from latentmotion.training.distributed import DistributedContext
from latentmotion.training.experiment import TrainingSettings
from latentmotion.training.loop import Stage, train
from latentmotion.training.run_folder import open_run
from latentmotion.training.text_encoder import data as text_data
from latentmotion.training.text_encoder.data import TaggedCaption

POOLED_WEIGHT = 20.0
RELATION_WEIGHT = 20.0
CARD_FILE = "card.json"
LICENSE = "Apache-2.0 (started from all-MiniLM-L6-v2, Apache-2.0; captions HumanML3D, MIT)"


@dataclass(frozen=True)
class StudentRecipe:
    """Everything that decides what the distillation yields, but captions and teacher."""

    layers: tuple[int, ...] = (0, 2, 5)
    """The teacher's layer that each layer of the student starts from."""
    words: int = 8000
    """Frequent English words in the vocabulary, besides the pieces of the captions."""
    continuations: int = 1200
    """Frequent word ends (`##ing`) in the vocabulary, besides those of the captions."""
    positions: int = 128
    """Longest sentence in pieces; longer ones are cut."""
    training: TrainingSettings = field(
        default_factory=lambda: TrainingSettings(
            steps=7000, batch_size=64, learning_rate=5e-4, warm_up=200, ema_decay=0.0,
            precision="auto", report_every=100, snapshot_every=500, sample_every=0,
        )
    )  # fmt: skip
    """Optimization; the seed also decides the variations of captions."""


def distillation_losses(
    pooled: Float[torch.Tensor, "batch width"],
    states: Float[torch.Tensor, "batch words width"],
    batch: text_data.SentenceBatch,
) -> dict[str, torch.Tensor]:
    """Returns the losses of one batch; "total" weights the others as stated at the top.

    Args:
        pooled: The student's sentence embeddings of unit length.
        states: The student's piece states.
        batch: The sentences with the teacher's outputs.
    """
    sentence = (pooled - batch.pooled).square().sum(1).mean()
    relation = (pooled @ pooled.T - batch.pooled @ batch.pooled.T).square().mean()
    error = (states[batch.aligned] - batch.words).square().sum(1)
    words = (error / batch.words.square().sum(1)).sum() / max(1, len(batch.words))
    total = POOLED_WEIGHT * sentence + words + RELATION_WEIGHT * relation
    return {"total": total, "sentence": sentence, "words": words, "relation": relation}


class TextEncoderStage(Stage[StudentNetwork]):
    """The student, the sentences it is trained on, and those it is validated on.

    Args:
        network: The network to train.
        data: Sentences with the teacher's outputs.
        held_out: At least 33 other sentences.
        settings: Batch size and seed.
        context: The device and rank.
    """

    def __init__(
        self,
        network: StudentNetwork,
        data: text_data.TrainingSet,
        held_out: text_data.ValidationSentences,
        settings: TrainingSettings,
        context: DistributedContext,
    ) -> None:
        super().__init__()
        self.network = network
        self._data, self._held_out, self._context = data, held_out, context
        lengths = np.array([len(row) for row in data.ids])
        self._sampler = text_data.SentenceSampler(lengths, settings.batch_size, settings.seed)

    def forward(self, step: int) -> dict[str, torch.Tensor]:
        """Losses of step number `step`."""
        rows, device = self._sampler(step), self._context.device
        batch = self._data.batch(rows[self._context.ranks.shard(len(rows))]).to(device)
        pooled, states = self.network(batch.tokens, batch.mask)
        with torch.autocast(device.type, enabled=False):
            return distillation_losses(pooled, states.float(), batch)

    @torch.no_grad()
    def validate(self, network: StudentNetwork) -> dict[str, float]:
        """Agreement with the teacher on held-out sentences, see `Figures`."""
        ids, device = self._held_out.ids, self._context.device
        batches = (
            text_data.padded(ids[first : first + AT_ONCE]) for first in range(0, len(ids), AT_ONCE)
        )
        pooled = [network(tokens.to(device), mask.to(device))[0] for tokens, mask in batches]
        figures = text_data.compare(torch.cat(pooled).cpu().numpy(), self._held_out.pooled)
        return {k: v for k, v in dataclasses.asdict(figures).items() if k != "sentences"}


@dataclass(frozen=True)
class TextEncoderRun:
    """Settings that the run folder of a text encoder was made with."""

    captions: str
    """Fingerprint of the captions."""
    teacher: str
    """Kind and source of the teacher."""
    recipe: StudentRecipe
    """Everything else that decides what the run yields."""
    stage: str = "text-encoder"
    """Settings that distinguish it from other runs."""


def train_text_encoder(
    recipe: StudentRecipe,
    captions: Sequence[text_data.TaggedCaption],
    teacher: PretrainedTextEncoder,
    folder: Path,
    context: DistributedContext,
) -> Path:
    """Distills a text encoder, or resumes it; returns the folder with its files and card.

    Args:
        recipe: Sizes of the student and settings of its training.
        captions: Captions of motions; one in twenty is held out for validation.
        teacher: MiniLM or another BERT whose sentence embedding is the mean of the piece states.
        folder: Run folder; the encoder is written to `encoder/` in it.
        context: The device and rank.

    Raises:
        DataError: Fewer than 33 captions are held out.
        InputError: The run folder holds another run.
    """
    held_out = held_out_sentences(captions)
    corpus = json.dumps([(caption.text, caption.tags) for caption in captions])
    digest = hashlib.sha256(corpus.encode()).hexdigest()
    open_run(folder, TextEncoderRun(digest, teacher.name, recipe), context)
    large = Tokenizer.from_str(teacher.tokenizer.backend_tokenizer.to_str())
    large.no_padding()
    large.enable_truncation(recipe.positions)
    texts = [caption.text for caption in captions]
    pieces = text_data.pieces_to_keep(large, texts, recipe.words, recipe.continuations)
    small = text_data.restrict(large, pieces, recipe.positions)
    sentences = training_sentences(captions, large, recipe)
    targets = text_data.teacher_targets(folder / "targets", sentences, large, teacher, context)
    data = text_data.TrainingSet(_ids(small, sentences), aligned(sentences, large, small), targets)
    measured = text_data.ValidationSentences(
        held_out, _ids(small, held_out), teacher(held_out).pooled
    )
    network = first_network(recipe, teacher.model, text_data.places_in(large, small))
    stage = TextEncoderStage(network, data, measured, recipe.training, context)
    network, _ = train(stage, recipe.training, folder, context)
    encoder = folder / "encoder"
    if context.is_main:
        encoder.mkdir(exist_ok=True)
        export_student(network.cpu(), small, known_words(small, texts), encoder)
        write_card(encoder, recipe, teacher.name, measured)
    return encoder


def held_out_sentences(captions: Sequence[text_data.TaggedCaption]) -> list[str]:
    """Returns the held-out captions in random order.

    Raises:
        DataError: There are fewer than 33, one group of the validation.
    """
    sentences = sorted(caption.text for caption in captions if text_data.is_held_out(caption.text))
    if len(sentences) < text_data.GROUP:
        raise DataError(
            f"{len(sentences)} of {len(captions)} captions are held out for validation, expected "
            f"{text_data.GROUP} or more; use more captions"
        )
    random.Random(0).shuffle(sentences)
    return sentences


def training_sentences(
    captions: Sequence[text_data.TaggedCaption], tokenizer: Tokenizer, recipe: StudentRecipe
) -> list[str]:
    """Returns captions, a variation of each, short phrases and the empty sentence, sorted.

    Args:
        captions: All captions; held-out ones are left out.
        tokenizer: The teacher's tokenizer.
        recipe: Number of frequent words, and the seed of the variations.
    """
    generator = random.Random(recipe.training.seed)
    words = text_data.frequent_words(tokenizer, recipe.words)
    train = [caption for caption in captions if not text_data.is_held_out(caption.text)]
    sentences = [caption.text for caption in train]
    sentences += [vary(caption, words, generator) for caption in train]
    sentences += plain_phrases(train, words, generator)
    return sorted({text for text in sentences if not text_data.is_held_out(text)} | {""})


def aligned(sentences: Sequence[str], large: Tokenizer, small: Tokenizer) -> list[bool]:
    """Returns for each sentence whether both tokenizers split it into the same pieces."""
    texts = list(sentences)
    pairs = zip(large.encode_batch(texts), small.encode_batch(texts), strict=True)
    return [theirs.tokens == ours.tokens for theirs, ours in pairs]


def first_network(recipe: StudentRecipe, teacher: Any, pieces_kept: np.ndarray) -> StudentNetwork:
    """Returns the untrained student, made of the teacher's layers and piece embeddings.

    Args:
        recipe: Layers to keep and number of positions.
        teacher: Hugging Face's `BertModel`.
        pieces_kept: The teacher's id of each piece of the student.
    """
    config = teacher.config
    shape = NetworkShape(
        len(pieces_kept), config.hidden_size, len(recipe.layers), config.num_attention_heads,
        config.intermediate_size, recipe.positions,
    )  # fmt: skip
    network = StudentNetwork(shape)
    pieces = pieces_kept.tolist()
    state = teacher_state(teacher.state_dict(), pieces, recipe.layers, recipe.positions)
    network.load_state_dict(state)
    return network


def known_words(tokenizer: Tokenizer, texts: Sequence[str]) -> list[str]:
    """Returns words that the tokenizer splits but that occur twice or more, so are no typos."""
    split = Counter(word for text in texts for word in split_words(tokenizer, text))
    return [word for word, count in split.items() if count > 1]


def write_card(
    folder: Path, recipe: StudentRecipe, teacher: str, held_out: text_data.ValidationSentences
) -> None:
    """Writes the card of an exported student: origin, agreement with the teacher, speed, sizes."""
    student = StudentTextEncoder.load(folder)
    with silent_of_unknown():
        figures = text_data.compare(student(held_out.sentences).pooled, held_out.pooled)
        pace = text_data.milliseconds(student, held_out.sentences[:300])
    card = {
        "name": student.name,
        "teacher": "all-MiniLM-L6-v2" if teacher.startswith("minilm") else teacher,
        "license": LICENSE,
        "recipe": dataclasses.asdict(recipe),
        "held_out": dataclasses.asdict(figures),
        "milliseconds_a_sentence": pace,
        "bytes": {p.name: p.stat().st_size for p in folder.iterdir() if p.name != CARD_FILE},
    }
    with atomic_file(folder / CARD_FILE) as temporary:
        temporary.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")


def _ids(tokenizer: Tokenizer, sentences: Sequence[str]) -> list[list[int]]:
    return [encoding.ids for encoding in tokenizer.encode_batch(list(sentences))]


# `subjects`, `synonyms`, `activities`, `manners`, and `frames` that verbs and activities fill.
_WORDS = tomllib.loads(Path(__file__).with_name("augmentation.toml").read_text(encoding="utf-8"))

_SUBJECT = re.compile(
    r"^(?:(?:a|an|the|this)\s+)?(?:standing\s+)?"
    r"(?:person|man|woman|figure|human|someone|somebody|he|she|they|guy|character)\b"
)
_CLAUSES = re.compile(r"\s*(?:,|\.|;|\band then\b|\bthen\b|\band\b|\bwhile\b|\bbefore\b)\s*")
_SYNONYM_GROUP = {word: group for group in _WORDS["synonyms"] for word in group}


def vary(caption: TaggedCaption, words: Sequence[str], generator: random.Random) -> str:
    """Returns one random variation of a caption.

    Args:
        caption: The caption.
        words: English words, one of which replaces a random word in one variation of five.
        generator: Draws every choice.
    """
    form = generator.choice((None, "clause", "imperative"))
    text = caption.text
    if form == "clause":
        clauses = [clause for clause in _CLAUSES.split(text) if clause]
        text = generator.choice(clauses) if clauses else text
    elif form == "imperative":
        text = _imperative(caption, generator)
    if generator.random() < 0.6:
        text = _SUBJECT.sub(generator.choice(_WORDS["subjects"]), text)
    if generator.random() < 0.6:
        text = " ".join(
            generator.choice(_SYNONYM_GROUP[word])
            if word in _SYNONYM_GROUP and generator.random() < 0.5
            else word
            for word in text.split()
        )
    if generator.random() < 0.2:
        parts = text.split()
        if parts and words:
            parts[generator.randrange(len(parts))] = generator.choice(words)
        text = " ".join(parts)
    if generator.random() < 0.15 and len(text) >= 4:  # one letter dropped, doubled or swapped
        at = generator.randrange(len(text) - 1)
        first, second = text[at], text[at + 1]
        text = text[:at] + generator.choice(("", first * 2, second + first)) + text[at + 1 :]
    bare = text.strip(" .,")
    return bare + generator.choice((".", "", "", "!")) if bare else text


def plain_phrases(
    captions: Iterable[TaggedCaption], words: Sequence[str], generator: random.Random
) -> list[str]:
    """Returns short prompts, such as "a person is walking", "play tennis" or "chair".

    Args:
        captions: Captions whose verbs and nouns are used.
        words: English words, each of which is a prompt of its own.
        generator: Draws manners ("backwards") and pairs of verb and noun.
    """
    tags = [tag for caption in captions for tag in caption.tags]
    verbs = sorted({lemma for lemma, tag in tags if tag == "VERB" and lemma.isalpha()})
    nouns = sorted({lemma for lemma, tag in tags if tag == "NOUN" and lemma.isalpha()})
    phrases = []
    for verb in verbs:
        forms = {"plain": verb, "goes": third_person(verb), "going": present_participle(verb)}
        phrases += [frame.format_map(forms) for frame in _WORDS["verb_frames"]]
    phrases += [f"{phrase} {generator.choice(_WORDS['manners'])}".strip() for phrase in phrases]
    phrases += [
        frame.format(what) for what in _WORDS["activities"] for frame in _WORDS["activity_frames"]
    ]
    phrases += [f"{generator.choice(verbs)} {generator.choice(nouns)}" for _ in nouns]
    return phrases + nouns + list(words)


def _imperative(caption: TaggedCaption, generator: random.Random) -> str:
    """Lemmas from the first verb on, "walk forward then turn", cut at a random length."""
    verbs = [index for index, (_, tag) in enumerate(caption.tags) if tag == "VERB"]
    if not verbs:
        return caption.text
    lemmas = [lemma for lemma, _ in caption.tags[verbs[0] :]]
    return " ".join(lemmas[: generator.randint(1, len(lemmas))])
