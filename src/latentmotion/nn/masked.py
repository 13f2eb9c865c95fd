"""Means over the real part of padded batches."""

from __future__ import annotations

from jaxtyping import Bool, Float
from torch import Tensor


def mean_of_real(
    values: Float[Tensor, "batch length *_ width"], mask: Bool[Tensor, "batch length"]
) -> Float[Tensor, ""]:
    """Returns the mean over each row's real part, then over rows.

    So padding weighs nothing, and the mean of a batch is the mean of its equal parts.
    """
    weights = mask / mask.sum(dim=1, keepdim=True)
    return (values.flatten(2).mean(dim=2) * weights).sum(dim=1).mean()


def mean_of_all(
    values: Float[Tensor, "batch length *_ width"], mask: Bool[Tensor, "batch length"]
) -> Float[Tensor, ""]:
    """Returns the mean over padding as well: a quirk of the authors' losses."""
    return values.mean()
