"""What the MLD authors' evaluation does that a clean one would not; all off by default.

Each is named with the section of the specification of their code that tells of it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DrawnPairs:
    """Random pairs in place of all pairs (spec 11.2, 11.4)."""

    text_diversity: int = 300
    """Pairs of diversity with a text-motion evaluator; each of the two draws without
    replacement."""
    action_diversity: int = 300
    """Pairs of generated motions with an action classifier; with replacement."""
    action_multimodality: int = 10
    """Pairs of a label, of generated motions."""
    true_action_diversity: int = 200
    """Pairs of real motions: the default of their function."""
    true_action_multimodality: int = 20
    """Pairs of a label, of real motions: the default of their function."""
    kid_subsets: int = 100
    """Subsets from which KID is averaged (11.2)."""
    kid_size: int = 1000
    """Motions of a subset."""


@dataclass(frozen=True)
class Quirks:
    """Switches; False, or None, is the clean way."""

    random_crops: bool = False
    """Start and length of a clip's crop are drawn anew in every replication, and one in three is
    a unit shorter (spec 8). Clean: from the first frame, as long as it can be."""
    random_captions: bool = False
    """One of a clip's captions is drawn (spec 8). Clean: they take turns."""
    remainder_dropped: bool = False
    """Items beyond the last full group of 32 have no R-precision and MM-Dist (spec 11.2). Clean:
    others, whose own rank does not count again, fill the last group."""
    float32_means: bool = False
    """FID's means are computed in float32 (spec 11.2)."""
    drawn_pairs: DrawnPairs | None = None
    """Diversity, MultiModality and KID from random pairs (spec 11.2, 11.4). Clean: from all."""
    permuted_truth: bool = False
    """The FID of the ground truth is that to itself in another order, nearly 0 (spec 11.4).
    Clean: between two random halves, the noise that a set of this size brings."""
    sampled_latents: bool = False
    """A VAE repeats a motion from latents drawn of its posterior (spec 11.2). Clean: from the
    mean."""
    padded_sums: bool = False
    """MPJPE and ACCL sum over the padding of batches of 32 motions, and divide by the number of
    true frames (spec 11.3)."""
    random_state: bool = False
    """The GRU of the action classifier starts from a random state in every call (spec 11.4)."""
    population_deviation: bool = False
    """The deviation of replications is divided by their number (spec 11.2). Clean: by one less."""


AUTHORS = Quirks(
    random_crops=True,
    random_captions=True,
    remainder_dropped=True,
    float32_means=True,
    drawn_pairs=DrawnPairs(),
    permuted_truth=True,
    sampled_latents=True,
    padded_sums=True,
    random_state=True,
    population_deviation=True,
)
"""All of them."""
