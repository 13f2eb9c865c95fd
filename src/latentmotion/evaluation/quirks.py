"""What the MLD authors' evaluation does that a clean one would not; all off by default.

Each names the section of docs/reference/mld.md that describes it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DrawnPairs:
    """Random pairs in place of all pairs (mld.md §8, §10)."""

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
    """Subsets from which KID is averaged (mld.md §8)."""
    kid_size: int = 1000
    """Motions of a subset."""


@dataclass(frozen=True)
class Quirks:
    """Switches; False, or None, is the clean way."""

    random_crops: bool = False
    """Start and length of a clip's crop are drawn anew in every replication, and one in three is
    a unit shorter (mld.md §5). Clean: from the first frame, as long as it can be."""
    random_captions: bool = False
    """One of a clip's captions is drawn (mld.md §5). Clean: they take turns."""
    remainder_dropped: bool = False
    """Items beyond the last full group of 32 have no R-precision and MM-Dist (mld.md §8). Clean:
    others, whose own rank does not count again, fill the last group."""
    float32_means: bool = False
    """FID's means are computed in float32 (mld.md §8)."""
    drawn_pairs: DrawnPairs | None = None
    """Diversity, MultiModality and KID from random pairs (mld.md §8, §10). Clean: from all."""
    permuted_truth: bool = False
    """The FID of the ground truth is that to itself in another order, nearly 0 (mld.md §10).
    Clean: between two random halves, the noise that a set of this size brings."""
    sampled_latents: bool = False
    """A VAE repeats a motion from latents drawn of its posterior (mld.md §8). Clean: from the
    mean."""
    padded_sums: bool = False
    """MPJPE and ACCL sum over the padding of batches of 32 motions, and divide by the number of
    true frames (mld.md §9)."""
    random_state: bool = False
    """The GRU of the action classifier starts from a random state in every call (mld.md §10)."""
    population_deviation: bool = False
    """The deviation of replications is divided by their number (mld.md §8). Clean: by one less."""


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
