"""Scores of one replication: metrics of embeddings of motions and captions, and of joint positions.

Positions need no evaluator. HumanAct12's classifier sees joints, as metrics of positions do;
UESTC's sees rotations alone. Published figures are those of SMPL's neutral body, whose file only
its registered users have.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from statistics import fmean
from typing import TypeGuard

import numpy as np
from jaxtyping import Float, Int

from latentmotion.data.clip import Caption
from latentmotion.data.dataset import Dataset
from latentmotion.errors import InputError
from latentmotion.evaluation import metrics
from latentmotion.evaluation.candidates import Generated
from latentmotion.evaluation.evaluators.action import Recognizer
from latentmotion.evaluation.evaluators.interface import Evaluator, TextMotionEvaluator
from latentmotion.evaluation.protocol import Protocol, Replication, TestPrompt
from latentmotion.kinematics.plausibility import foot_sliding, jitter, penetration, skating_ratio
from latentmotion.kinematics.smpl import SmplModel
from latentmotion.representation.smpl import SmplRepresentation, representation_of

Motions = Sequence[Float[np.ndarray, "_ features"]]


@dataclass(frozen=True, eq=False)
class Embeddings:
    """An evaluator's embeddings of a set of motions and of their prompts."""

    motions: Float[np.ndarray, "items width"]  # Embeddings of the motions.
    logits: Float[np.ndarray, "items labels"] | None = None  # Logits of an action classifier.
    labels: Int[np.ndarray, " items"] | None = None  # Labels of the prompts, if they have such.
    # Embeddings of the captions, if there are such.
    texts: Float[np.ndarray, "items width"] | None = None


@dataclass(eq=False)
class EmbeddingCache:
    """An evaluator with the embeddings of captions, which it need not compute twice."""

    evaluator: Evaluator  # The evaluator, of either kind.
    _texts: dict[Caption, Float[np.ndarray, " width"]] = field(default_factory=dict)

    def embed(
        self, motions: Motions, replication: Replication, noise: np.random.Generator | None = None
    ) -> Embeddings:
        """Embeds motions and their prompts.

        Args:
            motions: The motions.
            replication: Their prompts.
            noise: Makes the GRU of an action classifier start from a random state.

        Raises:
            InputError: A label is unknown to the classifier.
        """
        evaluator = self.evaluator
        if isinstance(evaluator, TextMotionEvaluator):
            return Embeddings(evaluator.motions(motions), texts=self.texts(replication.prompts))
        if isinstance(evaluator, Recognizer):
            evaluator = replace(evaluator, noise=noise)
        recognition = evaluator(motions)
        actions = [prompt.item.clip.action for prompt in replication.prompts]
        if None in actions:
            return Embeddings(recognition.features, recognition.logits)
        names = list(evaluator.labels)
        unknown = sorted({str(label) for label in actions} - set(names))
        if unknown:
            raise InputError(
                f"the evaluator does not know the label {unknown[0]!r}, only {', '.join(names)}; "
                "take one that was trained on this data set"
            )
        labels = np.array([names.index(str(label)) for label in actions])
        return Embeddings(recognition.features, recognition.logits, labels)

    def motions(self, motions: Motions) -> Float[np.ndarray, "items width"]:
        """Returns the embeddings of motions, whatever their prompts."""
        evaluator = self.evaluator
        if isinstance(evaluator, TextMotionEvaluator):
            return evaluator.motions(motions)
        return evaluator(motions).features

    def texts(self, prompts: Sequence[TestPrompt]) -> Float[np.ndarray, "items width"] | None:
        """Returns the embeddings of captions; None if a prompt has none or they are not read."""
        captions = [prompt.caption for prompt in prompts if prompt.caption]
        if len(captions) < len(prompts) or not isinstance(self.evaluator, TextMotionEvaluator):
            return None
        new = [caption for caption in dict.fromkeys(captions) if caption not in self._texts]
        if new:
            self._texts |= dict(zip(new, self.evaluator.texts(new), strict=True))
        return np.stack([self._texts[caption] for caption in captions])


Scores = dict[str, float]


def embedding_scores(
    embeddings: Embeddings, real: Embeddings, prompted: bool, protocol: Protocol, replication: int
) -> Scores:
    """Returns the figures of a candidate's motions.

    Args:
        embeddings: The candidate's motions.
        real: The real motions.
        prompted: Whether the motions depend on captions or labels.
        protocol: Rules of the evaluation.
        replication: Number of the replication.
    """
    scores = {
        "Diversity": _diversity(embeddings, protocol, replication, real=False),
        **_distances(embeddings, real, protocol, replication, paired=True),
    }
    if prompted:
        scores |= _prompt_scores(embeddings, protocol, replication, real=False)
    return scores


def ground_truth_scores(real: Embeddings, protocol: Protocol, replication: int) -> Scores:
    """Returns the figures of the real motions; FID and KID are those of two random halves."""
    order = protocol.generator("halves", replication).permutation(len(real.motions))
    half = len(order) // 2
    # A covariance needs two motions; with fewer, both sides are all of them.
    whole = protocol.quirks.permuted_truth or half < 2
    rows, other_rows = (order, slice(None)) if whole else (order[:half], order[half:])
    first, second = Embeddings(real.motions[rows]), Embeddings(real.motions[other_rows])
    return {
        **_distances(first, second, protocol, replication, paired=False),
        "Diversity": _diversity(real, protocol, replication, real=True),
        **_prompt_scores(real, protocol, replication, real=True),
    }


def measures_multimodality(candidate: Generated, protocol: Protocol, replication: int) -> bool:
    """Returns whether a replication measures MultiModality of captions."""
    repeats = protocol.repeats
    repeated = repeats.texts > 0 and repeats.samples > 1
    return repeated and candidate.card.condition.reads_text and replication < repeats.replications


def caption_multimodality(
    candidate: Generated, replication: Replication, cache: EmbeddingCache, protocol: Protocol
) -> float:
    """Generates many motions for some captions and returns their MultiModality."""
    repeats, number = protocol.repeats, replication.number
    generator = protocol.generator("repeats", number)
    count = min(repeats.texts, len(replication.prompts))
    rows = generator.choice(len(replication.prompts), count, replace=False)
    prompts = [replication.prompts[row] for row in rows for _ in range(repeats.samples)]
    seeds = [
        seed
        for row in rows
        for seed in protocol.seeds("repeats", number, repeats.samples, int(row))
    ]
    motions = candidate.generate(prompts, seeds)
    embeddings = np.asarray(cache.motions(motions)).reshape(count, repeats.samples, -1)
    if repeats.pairs is None:
        return metrics.multimodality(list(embeddings))
    pairs = min(repeats.pairs, repeats.samples)
    first, second = (generator.choice(repeats.samples, pairs, replace=False) for _ in range(2))
    return metrics.drawn_diversity(embeddings, first, second)


def groups(
    items: int, size: int, generator: np.random.Generator, drop: bool
) -> Iterator[tuple[Int[np.ndarray, " group"], int]]:
    """Yields random groups of items, each with the number of its first items that count.

    Args:
        items: Number of items.
        size: Items of a group; fewer items make one group.
        generator: Source of randomness.
        drop: Whether an incomplete last group is left out, or filled up with other items.
    """
    order, size = generator.permutation(items), min(size, items)
    full = items // size * size
    for start in range(0, full, size):
        yield order[start : start + size], size
    if full < items and not drop:
        rest = order[full:]
        yield np.concatenate([rest, order[: size - len(rest)]]), len(rest)


def _distances(
    first: Embeddings, second: Embeddings, protocol: Protocol, replication: int, paired: bool
) -> Scores:
    """FID and KID."""
    pairs, single = protocol.quirks.drawn_pairs, protocol.quirks.float32_means
    x, y = first.motions, second.motions
    distance = metrics.frechet_distance(
        metrics.Gaussian.of(x, single), metrics.Gaussian.of(y, single)
    )
    if pairs is None:
        return {"FID": distance, "KID": metrics.kid(x, y, paired)}
    generator = protocol.generator("kid", replication)
    drawn = metrics.drawn_kid(x, y, pairs.kid_subsets, pairs.kid_size, generator)
    return {"FID": distance, "KID": drawn}


def _diversity(embeddings: Embeddings, protocol: Protocol, replication: int, real: bool) -> float:
    pairs = protocol.quirks.drawn_pairs
    if pairs is None:
        return metrics.diversity(embeddings.motions)
    generator, items = protocol.generator("diversity", replication), len(embeddings.motions)
    if embeddings.logits is None:
        count = min(pairs.text_diversity, items)
        first, second = (generator.choice(items, count, replace=False) for _ in range(2))
    else:
        count = pairs.true_action_diversity if real else pairs.action_diversity
        first, second = generator.integers(items, size=(2, count))
    return metrics.drawn_diversity(embeddings.motions, first, second)


def _prompt_scores(
    embeddings: Embeddings, protocol: Protocol, replication: int, real: bool
) -> Scores:
    """R-precision and MM-Dist of captions; accuracy and MultiModality of labels."""
    scores: Scores = {}
    motions, texts, labels = embeddings.motions, embeddings.texts, embeddings.labels
    if texts is not None:
        generator = protocol.generator("groups", replication)
        drop = protocol.quirks.remainder_dropped
        drawn = list(groups(len(motions), protocol.group, generator, drop))
        places = np.concatenate(
            [metrics.ranks(texts[rows], motions[rows])[:scored] for rows, scored in drawn]
        )
        counted = np.concatenate([rows[:scored] for rows, scored in drawn])
        shares = metrics.r_precision(places)
        scores |= {f"R@{k}": share for k, share in zip(metrics.BEST, shares, strict=True)}
        scores["MM-Dist"] = metrics.mm_dist(texts[counted], motions[counted])
    if embeddings.logits is not None and labels is not None:
        scores["Accuracy"] = metrics.accuracy(embeddings.logits, labels)
        pairs = protocol.quirks.drawn_pairs
        if pairs is None:
            by_label = [motions[labels == label] for label in np.unique(labels)]
            scores["MultiModality"] = metrics.multimodality(by_label)
        else:
            quota = pairs.true_action_multimodality if real else pairs.action_multimodality
            chance = protocol.generator("multimodality", replication)
            first, second = metrics.label_pairs(labels, quota, lambda n: int(chance.integers(n)))
            scores["MultiModality"] = metrics.drawn_diversity(motions, first, second)
    return scores


Joints = Float[np.ndarray, "_ joints 3"]

BATCH = 32  # Motions that the authors pad together (mld.md §9).


@dataclass(frozen=True, eq=False)
class PositionScores:
    """Metrics of the joints of a data set's representation."""

    dataset: Dataset  # Source of representation, frame rate and training clips.

    def quality(self, motions: Motions) -> Scores:
        """Returns foot sliding, jitter and floor penetration of motions."""
        fps, skeleton = self.dataset.representation.fps, self.dataset.representation.skeleton
        bodies = [self._decode(motion) for motion in motions]
        scores = {
            "Jitter": fmean(jitter(body, fps) for body in bodies),
            "Penetration": 1000 * fmean(penetration(body) for body in bodies),
        }
        if skeleton.left_foot and skeleton.right_foot:
            scores["Foot sliding"] = fmean(foot_sliding(body, fps, skeleton) for body in bodies)
            scores["Skating"] = fmean(skating_ratio(body, fps, skeleton) for body in bodies)
        return scores

    def nearest(self, motions: Motions) -> Scores:
        """Returns the mean distance to the nearest training clip, mirrored ones too.

        Poses are compared as the representation has them, root-relative and facing ahead. Empty for
        a representation without such a block.
        """
        if "positions" not in self.dataset.representation.blocks:
            return {}
        poses = [self._poses(motion) for motion in motions]
        return {"Nearest clip": 1000 * fmean(self._training.distance(pose) for pose in poses)}

    def reconstruction(
        self, motions: Motions, real: Motions, padding: Float[np.ndarray, " features"] | None
    ) -> Scores:
        """Returns the errors of reconstructions, as means over all frames of all motions.

        Args:
            motions: The reconstructions.
            real: The real motions, of the same lengths.
            padding: Features that padding decodes from, to sum over it as the authors do; None for
                the clean sums.
        """
        pairs = [(a, b) for a, b in zip(motions, real, strict=True)]
        frames = sum(len(motion) for motion in real)
        inner = max(sum(max(len(motion) - 2, 0) for motion in real), 1)
        if padding is not None:
            # By length, each batch padded to its longest, as the authors' data loader does.
            ordered, pairs = sorted(pairs, key=lambda pair: len(pair[1])), []
            for start in range(0, len(ordered), BATCH):
                batch = ordered[start : start + BATCH]
                longest = max(len(real) for _, real in batch)
                for pair in batch:
                    tail = np.tile(padding, (longest - len(pair[1]), 1)).astype(pair[1].dtype)
                    pairs.append((np.concatenate([pair[0], tail]), np.concatenate([pair[1], tail])))
        bodies = [(self._decode(a), self._decode(b)) for a, b in pairs]
        return {
            "MPJPE": 1000 * sum(metrics.joint_errors(a, b).sum() for a, b in bodies) / frames,
            "PA-MPJPE": 1000 * sum(metrics.pa_errors(a, b).sum() for a, b in bodies) / frames,
            "ACCL": 1000 * sum(metrics.acceleration_errors(a, b).sum() for a, b in bodies) / inner,
        }

    def average_errors(self, motions: Motions, real: Motions) -> Scores:
        """Returns APE and AVE of motions against the real ones of the same lengths."""
        skeleton = self.dataset.representation.skeleton
        if not {"left_hip", "right_hip", "left_shoulder", "right_shoulder"} <= {*skeleton.names}:
            return {}
        values: dict[str, list[float]] = {}
        for pair in zip(motions, real, strict=True):
            a, b = (metrics.parts_of(self._decode(features), skeleton) for features in pair)
            for metric, errors in (("APE", metrics.ape(a, b)), ("AVE", metrics.ave(a, b))):
                for part, error in errors.items():
                    values.setdefault(f"{metric} {part}", []).append(error)
        return {name: fmean(errors) for name, errors in values.items()}

    def _decode(self, features: Float[np.ndarray, "frames features"]) -> Joints:
        return np.asarray(self.dataset.representation.decode(features), np.float64)

    def _poses(self, features: Float[np.ndarray, "frames features"]) -> Joints:
        positions = features[:, self.dataset.representation.blocks["positions"]]
        return positions.reshape(len(positions), -1, 3)

    @cached_property
    def _training(self) -> metrics.TrainingClips:
        clips = self.dataset.clips("train", mirrored=True)
        return metrics.TrainingClips([self._poses(self.dataset.features(clip)) for clip in clips])


def with_smpl_joints(
    body: SmplModel, dataset: Dataset, evaluator: Evaluator | None
) -> tuple[Dataset, Evaluator | None]:
    """Returns data set and evaluator with the joints of a SMPL model.

    Raises:
        InputError: The features are not SMPL's poses.
    """
    representation, features = representation_of(body), dataset.representation.name
    if features != representation.name:
        raise InputError(
            f"{dataset.folder} has features {features!r}, which are no poses of a SMPL body; "
            "leave --body out"
        )
    if _sees_joints(evaluator):
        evaluator = replace(evaluator, prepare=representation.camera_joints)
    return replace(dataset, representation=representation), evaluator


def body_of(dataset: Dataset) -> str:
    """Returns the hash of the SMPL model whose joints the data has; empty without one."""
    representation = dataset.representation
    return representation.body if isinstance(representation, SmplRepresentation) else ""


def lacks_smpl_joints(dataset: Dataset, evaluator: Evaluator | None) -> bool:
    """Returns whether an evaluator made for SMPL's joints sees the free skeleton's."""
    return _on_free_skeleton(dataset) and _sees_joints(evaluator)


def notes_on_joints(dataset: Dataset, evaluator: Evaluator | None) -> list[str]:
    """Returns a note if joints are not those of published figures."""
    if not _on_free_skeleton(dataset):
        return []
    lacking = lacks_smpl_joints(dataset, evaluator)
    which = "this evaluator's metrics and those" if lacking else "metrics"
    return [
        f"joints are those of the free skeleton: {which} of positions do not compare "
        "with published ones, which are of SMPL's body; give its file by --body"
    ]


def _on_free_skeleton(dataset: Dataset) -> bool:
    return isinstance(dataset.representation, SmplRepresentation) and not body_of(dataset)


def _sees_joints(evaluator: Evaluator | None) -> TypeGuard[Recognizer]:
    return isinstance(evaluator, Recognizer) and evaluator.network.sees_joints
