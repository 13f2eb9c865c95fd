"""What a model card keeps of a report: every row's means, and what they were measured by."""

from __future__ import annotations

from typing import Any

from latentmotion.evaluation.report import Report


def card_figures(report: Report) -> dict[str, Any]:
    """Returns the figures as plain values, rounded to what they are good for."""
    protocol, made = report.protocol, report.provenance
    rows = {
        row: {name: float(f"{figure.mean:.4g}") for name, figure in figures.items()}
        for row, figures in report.rows.items()
    }
    return {
        "data": f"{made.data} {made.data_hash}",
        "evaluator": made.evaluator,
        "protocol": protocol.name,
        "split": protocol.split,
        "replications": protocol.replications,
        "seed": protocol.seed,
        "motions": dict(report.items),
        "rows": rows,
    }
