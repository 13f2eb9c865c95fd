"""Networks of text and motion, the T2M evaluator's and small towers, and contrastive losses.

In the T2M evaluator (Guo et al., CVPR 2022) four frames become a movement by two strided
convolutions; a bidirectional GRU reads the movements, another the words, each word a vector plus
that of its part of speech. The same names as in the authors' files, so that their weights load as
they are.

D² is the matrix of squared distances between sentences and motions of a batch. A pair of different
rows whose sentence also describes that motion is no contrast and is left out.

* InfoNCE (van den Oord et al. 2018): −log softmax(−D²/temperature), over motions and sentences.
* Margin (Hadsell et al. 2006, as the T2M code has it): D² of pairs + max(0, margin − D)² of each
  sentence with one other motion.

The towers give vectors of unit length, close if they mean the same. Motions: two strided
convolutions, four frames to a token, then a small transformer. Sentences: the states of a text
encoder's word pieces, then another. Mean and maximum over the tokens become the vector. Rotations
and contacts are not read: they follow from positions, and inverse kinematics of foreign skeletons
would add its own errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional as F
from torch.nn.utils.rnn import pack_padded_sequence

from latentmotion.evaluation.evaluators.words import PARTS_OF_SPEECH
from latentmotion.model.config import TransformerConfig
from latentmotion.networks import transformer

FRAMES = 4  # Frames of a movement.


# A batch of normalized features and of words, what of them is real, and what becomes of them.
Frames, FrameMask = Float[Tensor, "batch frames features"], Bool[Tensor, "batch frames"]
Words, WordMask = Float[Tensor, "batch words word_width"], Bool[Tensor, "batch words"]
PartsOfSpeech, Vectors = Int[Tensor, "batch words"], Float[Tensor, "batch width"]


@dataclass(frozen=True)
class TextMotionConfig:
    """Sizes; the defaults are the official ones for HumanML3D."""

    features: int = 263  # Features of a frame.
    left_out: int = 4  # Last features of a frame that are ignored: the foot contacts.
    word_width: int = 300  # Numbers per word vector.
    movement_width: int = 512  # Channels of the convolutions, numbers per movement.
    motion_hidden: int = 1024  # State of the GRU over movements, in each direction.
    text_hidden: int = 512  # State of the GRU over words, in each direction.
    width: int = 512  # Numbers per motion and per sentence.
    dropout: float = 0.2  # Share of movement channels dropped in training.

    def build(self) -> TextMotionNetworks:
        """Returns the networks with random weights."""
        return TextMotionNetworks(self)


class MovementEncoder(nn.Module):
    """Four frames to a movement."""

    def __init__(self, features: int, width: int, dropout: float) -> None:
        super().__init__()
        self.main = nn.Sequential(
            nn.Conv1d(features, width, kernel_size=4, stride=2, padding=1),
            nn.Dropout(dropout),
            nn.LeakyReLU(0.2),
            nn.Conv1d(width, width, kernel_size=4, stride=2, padding=1),
            nn.Dropout(dropout),
            nn.LeakyReLU(0.2),
        )
        self.out_net = nn.Linear(width, width)

    def forward(self, features: Frames) -> Float[Tensor, "batch movements width"]:
        """Returns a movement for every four frames."""
        return self.out_net(self.main(features.transpose(1, 2)).transpose(1, 2))


class SequenceEncoder(nn.Module):
    """The last states of a bidirectional GRU to one vector."""

    def __init__(self, inputs: int, embedded: int, hidden: int, width: int) -> None:
        super().__init__()
        self.input_emb = nn.Linear(inputs, embedded)
        self.gru = nn.GRU(embedded, hidden, batch_first=True, bidirectional=True)
        self.hidden = nn.Parameter(torch.randn(2, 1, hidden))
        self.output_net = nn.Sequential(
            nn.Linear(2 * hidden, hidden),
            nn.LayerNorm(hidden),
            nn.LeakyReLU(0.2),
            nn.Linear(hidden, width),
        )

    def forward(
        self, inputs: Float[Tensor, "batch steps inputs"], lengths: Int[Tensor, " batch"]
    ) -> Vectors:
        """Returns one vector for the first `lengths` steps of each row."""
        packed = pack_padded_sequence(
            self.input_emb(inputs), lengths.cpu(), batch_first=True, enforce_sorted=False
        )
        _, last = self.gru(packed, self.hidden.repeat(1, len(inputs), 1))
        return self.output_net(torch.cat([last[0], last[1]], dim=-1))


class SentenceEncoder(SequenceEncoder):
    """Words with their parts of speech to one vector."""

    def __init__(self, words: int, hidden: int, width: int) -> None:
        super().__init__(words, hidden, hidden, width)
        self.pos_emb = nn.Linear(len(PARTS_OF_SPEECH), words)

    def read(self, words: Words, parts: PartsOfSpeech, lengths: Int[Tensor, " batch"]) -> Vectors:
        """Returns one vector for each sentence."""
        classes = nn.functional.one_hot(parts, len(PARTS_OF_SPEECH)).to(words.dtype)
        return self(words + self.pos_emb(classes), lengths)


class TextMotionNetworks(nn.Module):
    """All three networks.

    Args:
        config: Their sizes.
    """

    def __init__(self, config: TextMotionConfig) -> None:
        super().__init__()
        self.config = config
        channels, movement = config.features - config.left_out, config.movement_width
        hidden, width = config.motion_hidden, config.width
        self.movement_encoder = MovementEncoder(channels, movement, config.dropout)
        self.motion_encoder = SequenceEncoder(movement, hidden, hidden, width)
        self.text_encoder = SentenceEncoder(config.word_width, config.text_hidden, width)

    def motions(self, features: Frames, mask: FrameMask) -> Vectors:
        """Returns the vectors of normalized motions.

        As in the authors' code the movement before the padding sees a little of it: pass motions
        of one length, a multiple of four, where each must be what it is alone.
        """
        visible = features[..., : self.config.features - self.config.left_out]
        return self.motion_encoder(self.movement_encoder(visible), mask.sum(1) // FRAMES)

    def texts(self, words: Words, parts: PartsOfSpeech, mask: WordMask) -> Vectors:
        """Returns the vectors of sentences."""
        return self.text_encoder.read(words, parts, mask.sum(1))


# Logit of pairs that are no contrast.
_NEVER = -1e9


@dataclass(frozen=True)
class InfoNCE:
    """Each sentence is distinguished from all other motions of the batch, and vice versa."""

    temperature: float = 10.0  # Squared distance that counts as one unit of evidence.

    def __call__(
        self, squared: Float[Tensor, "batch batch"], matches: Bool[Tensor, "batch batch"]
    ) -> Float[Tensor, ""]:
        """Returns the loss; `matches` is True if a sentence (row) describes a motion (column)."""
        diagonal = torch.eye(len(matches), dtype=torch.bool, device=matches.device)
        logits = (-squared / self.temperature).masked_fill(matches & ~diagonal, _NEVER)
        targets = torch.arange(len(logits), device=logits.device)
        return (F.cross_entropy(logits, targets) + F.cross_entropy(logits.T, targets)) / 2


@dataclass(frozen=True)
class Margin:
    """Each sentence is pulled to its motion and pushed from the next one of the batch."""

    margin: float = 10.0  # Distance from which on other motions are far enough.

    def __call__(
        self, squared: Float[Tensor, "batch batch"], matches: Bool[Tensor, "batch batch"]
    ) -> Float[Tensor, ""]:
        """Returns the loss; `matches` is True if a sentence (row) describes a motion (column)."""
        near = squared.diagonal()
        # The square root has no slope at zero.
        far = squared.roll(-1, 1).diagonal().clamp(min=1e-6).sqrt()
        contrast = ~matches.roll(-1, 1).diagonal()
        return (near + contrast * F.relu(self.margin - far) ** 2).mean()


def squared_distances(
    sentences: Float[Tensor, "sentences width"], motions: Float[Tensor, "motions width"]
) -> Float[Tensor, "sentences motions"]:
    """Returns the squared distance of each sentence to each motion."""
    return ((sentences[:, None] - motions[None]) ** 2).sum(-1)


def top_hits(
    squared: Float[Tensor, "sentences motions"], matches: Bool[Tensor, "sentences motions"]
) -> list[float]:
    """Returns how often a motion that the sentence describes is among the nearest 1, 2, 3.

    Unlike R-precision, any such motion counts, not only the sentence's own.
    """
    nearest = torch.where(matches, squared, torch.inf).min(1).values
    before = ((squared < nearest[:, None]) & ~matches).sum(1)
    return [float((before < k).float().mean()) for k in (1, 2, 3)]


@dataclass(frozen=True)
class TowerConfig:
    """Sizes of the towers."""

    features: int = 263  # Features of a frame.
    left_out: int = 4  # Last features of a frame that are ignored: the foot contacts.
    # First and one past the last feature of the rotations, which are ignored.
    rotations: tuple[int, int] = (67, 193)
    word_width: int = 384  # Numbers per word vector.
    hidden: int = 128  # Numbers per token inside.
    motion_layers: int = 2  # Transformer layers over tokens of four frames.
    text_layers: int = 2  # Transformer layers over words.
    heads: int = 4  # Attention heads.
    width: int = 128  # Numbers per motion and per sentence.
    dropout: float = 0.1  # Share of numbers dropped in training.

    def build(self) -> TowerNetworks:
        """Returns the networks with random weights."""
        return TowerNetworks(self)


class TowerNetworks(nn.Module):
    """Both towers.

    Args:
        config: Their sizes.
    """

    def __init__(self, config: TowerConfig) -> None:
        super().__init__()
        self.config = config
        first, last = config.rotations
        channels = config.features - config.left_out - (last - first)
        self.halve = nn.Conv1d(channels, config.hidden, kernel_size=4, stride=2, padding=1)
        self.quarter = nn.Conv1d(config.hidden, config.hidden, kernel_size=4, stride=2, padding=1)
        self.motion_tower = Tower(config, config.motion_layers)
        self.words_in = nn.Linear(config.word_width, config.hidden)
        self.text_tower = Tower(config, config.text_layers)
        self.apply(transformer.initialize)

    def motions(self, features: Frames, mask: FrameMask) -> Vectors:
        """Returns the vectors of normalized motions; frames whose mask is False are zero."""
        first, last = self.config.rotations
        end = self.config.features - self.config.left_out
        visible = torch.cat([features[..., :first], features[..., last:end]], dim=-1)
        # What lies beyond the end is zero at every stage, as it is for the motion alone.
        half, tokens = mask[:, ::2], mask[:, ::4]
        x = F.gelu(self.halve(visible.transpose(1, 2))) * half[:, None]
        x = F.gelu(self.quarter(x)).transpose(1, 2)
        return self.motion_tower(x, tokens)

    def texts(self, words: Words, parts: PartsOfSpeech, mask: WordMask) -> Vectors:
        """Returns the vectors of sentences; parts of speech are not read."""
        return self.text_tower(self.words_in(words), mask)


class Tower(nn.Module):
    """Tokens to one vector of unit length.

    Args:
        config: Sizes.
        layers: Transformer layers.
    """

    def __init__(self, config: TowerConfig, layers: int) -> None:
        super().__init__()
        width, dropout = config.hidden, config.dropout
        sizes = TransformerConfig(
            width, layers, config.heads, 2 * width, dropout, dropout, norm="pre"
        )
        self.position = transformer.SinePosition(width, dropout)
        encoder = [transformer.EncoderLayer(sizes) for _ in range(layers)]
        self.layers = transformer.Stack(encoder, nn.LayerNorm(width))
        self.out = nn.Linear(2 * width, config.width)

    def forward(
        self, x: Float[Tensor, "batch tokens hidden"], mask: Bool[Tensor, "batch tokens"]
    ) -> Vectors:
        """Returns the vectors of the tokens whose mask is True."""
        x = self.layers(self.position(x), mask)
        real = mask[..., None].to(x.dtype)
        mean = (x * real).sum(1) / real.sum(1)
        # Half precision reaches -65504; padding must never be the maximum.
        most = torch.where(mask[..., None], x, -1e4).amax(1)
        return F.normalize(self.out(torch.cat([mean, most], dim=-1)), dim=-1)
