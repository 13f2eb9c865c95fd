"""What real motions score in the papers: where ours do not, something is wrong with the setup.

The ground-truth row depends on nothing but data, evaluator and protocol. If it leaves the published
interval, then the data were processed otherwise (HumanML3D issues 3 and 21), the evaluator is not
the official one, or its statistics are not those it was trained with; no other row compares then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from latentmotion.evaluation.report import Figure


@dataclass(frozen=True)
class PublishedTruth:
    """The ground-truth row of a data set in a paper's table."""

    source: str
    """Name of the data set's source in a prepared folder."""
    paper: str
    """Where the figures stand."""
    figures: Mapping[str, tuple[float, float]]
    """Mean and 95 % interval by metric."""


_TABLES = "MLD (CVPR 2023)"

PUBLISHED = (
    PublishedTruth(
        "humanml3d",
        f"{_TABLES}, table 1",
        {
            "R@1": (0.511, 0.003),
            "R@2": (0.703, 0.003),
            "R@3": (0.797, 0.002),
            "MM-Dist": (2.974, 0.008),
            "Diversity": (9.503, 0.065),
        },
    ),
    PublishedTruth(
        "kit",
        f"{_TABLES}, appendix",
        {
            "R@1": (0.424, 0.005),
            "R@2": (0.649, 0.006),
            "R@3": (0.779, 0.006),
            "MM-Dist": (2.788, 0.012),
            "Diversity": (11.08, 0.097),
        },
    ),
    PublishedTruth(
        "humanact12",
        f"{_TABLES}, table 4",
        {"Accuracy": (0.997, 0.001), "Diversity": (6.850, 0.050), "MultiModality": (2.450, 0.040)},
    ),
)
"""The real rows; their FID is left out, since it is that of a set to itself (mld.md §10)."""


def published_truth(sources: Sequence[str], official: bool) -> PublishedTruth | None:
    """Returns the published row that a report's ground truth can be held against.

    Args:
        sources: Names of the data set's sources; a mixture of several matches none.
        official: Whether the evaluator is the one that the papers used.
    """
    if not official or len(sources) != 1:
        return None
    return next((row for row in PUBLISHED if row.source == sources[0]), None)


def departures(truth: Mapping[str, Figure], published: PublishedTruth) -> list[str]:
    """Says which figures of the ground truth are outside, both intervals allowed for."""
    return [
        f"the ground truth's {name} is {truth[name]}, published {mean:g} ± {interval:g} "
        f"({published.paper}): data, evaluator or its statistics are not those of the paper, "
        "and no row compares with it"
        for name, (mean, interval) in published.figures.items()
        if name in truth and abs(truth[name].mean - mean) > interval + (truth[name].interval or 0.0)
    ]
