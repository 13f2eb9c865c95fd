"""Unconditional motion (paper, table 6): by diffusion, and by sampling the VAE's prior."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table


def _mld(tokens: int) -> Row:
    name = f"mld_{tokens}"
    paper = published.UNCONDITIONAL.get(name, {})
    title = f"MLD ({tokens} token{'s' if tokens > 1 else ''})"
    return Row(name, title, model=f"unconditional_{name}", guidance=1.0, paper=paper)


UNCONDITIONAL = Table(
    name="unconditional",
    title="Unconditional motion",
    where="table 6",
    metrics=("FID", "KID", "Diversity"),
    expects="One token generates far better than seven.",
    rows=(
        Row("real", "Real", "real"),
        Row("prior_actor", "ACTOR, its prior", "prior", "actor"),
        Row("prior_vposer_t", "VPoser-t, its prior", "prior", "vposer_t"),
        Row("prior_mld_1", "MLD's VAE (1 token), its prior", "prior", "mld_1"),
        *map(_mld, (1, 2, 5, 7)),
    ),
)
