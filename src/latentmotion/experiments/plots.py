"""The figures: training curves, time against FID, guidance, latents along the reverse process."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.errors import MissingExtraError
from latentmotion.storage.files import atomic_file

SIZE = (7.0, 4.5)
"""Inches of a plot of one panel."""

DOTS = 130
"""Dots per inch."""

Points = Sequence[tuple[float, float]]


def training_curves(path: Path, curves: Mapping[str, Mapping[str, Points]]) -> None:
    """Draws the loss and the joint error of held-out clips by optimizer step.

    Args:
        path: PNG to write.
        curves: For each run its `loss` and `error`, as (step, value).
    """
    figure, panels = _figure(columns=2)
    labels = {"loss": "Training loss", "error": "Joint error of held-out clips, mm"}
    for panel, (part, label) in zip(panels, labels.items(), strict=True):
        for name, run in curves.items():
            panel.plot(*zip(*run[part], strict=True), label=name)
        panel.set(xlabel="Optimizer step", ylabel=label)
        _finish(panel)
    _save(figure, path)


def time_against_fid(path: Path, series: Mapping[str, Sequence[tuple[str, float, float]]]) -> None:
    """Draws FID by seconds per motion.

    Args:
        path: PNG to write.
        series: For each method its (label, seconds, FID).
    """
    figure, (panel,) = _figure()
    for name, points in series.items():
        ordered = sorted(points, key=lambda point: point[1])
        panel.plot([p[1] for p in ordered], [p[2] for p in ordered], "o-", label=name)
        for label, x, y in ordered:
            panel.annotate(label, (x, y), xytext=(5, 5), textcoords="offset points", fontsize=8)
    panel.set(xlabel="Time per motion, s (one at a time)", ylabel="FID", xscale="log")
    panel.margins(x=0.15, y=0.12)
    _finish(panel)
    _save(figure, path)


def by_guidance(
    path: Path, scales: Sequence[float], figures: Mapping[str, Sequence[float]]
) -> None:
    """Draws metrics by guidance scale, one panel each.

    Args:
        path: PNG to write.
        scales: The scales.
        figures: For each metric its value at each scale.
    """
    figure, panels = _figure(columns=len(figures))
    for panel, (name, values) in zip(panels, figures.items(), strict=True):
        panel.plot(scales, values, "o-")
        panel.set(xlabel="Guidance scale s", ylabel=name)
        panel.grid(alpha=0.3)
    _save(figure, path)


def latent_maps(
    path: Path,
    maps: Mapping[str, Float[np.ndarray, "items 2"]],
    labels: Sequence[str],
) -> None:
    """Draws t-SNE maps side by side, colored by action.

    Args:
        path: PNG to write.
        maps: A map by what it shows, e.g. `t = 981`.
        labels: The action of each item.
    """
    figure, panels = _figure(columns=len(maps), width=3.4)
    actions = sorted(set(labels))
    for panel, (name, places) in zip(panels, maps.items(), strict=True):
        for number, action in enumerate(actions):
            chosen = np.array([label == action for label in labels])
            color = f"C{number % 10}"
            marker = "ox^sDvP*"[number // 10 % 8]
            panel.scatter(*places[chosen].T, s=9, color=color, marker=marker, label=action)
        panel.set(title=name, xlabel="t-SNE 1", xticks=[], yticks=[])
    panels[0].set_ylabel("t-SNE 2")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=6, fontsize=8, markerscale=2)
    _save(figure, path)


def _figure(columns: int = 1, width: float | None = None) -> tuple[Any, list[Any]]:
    try:
        # Not pyplot: it would want a display and keep every figure.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise MissingExtraError("plots", "matplotlib", "train") from error
    inches = (columns * (width or (SIZE[0] if columns == 1 else 4.4)), SIZE[1])
    figure = Figure(figsize=inches, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(np.atleast_1d(figure.subplots(1, columns)))


def _finish(panel: Any) -> None:
    panel.grid(alpha=0.3)
    panel.legend()


def _save(figure: Any, path: Path) -> None:
    with atomic_file(path) as temporary:
        figure.savefig(temporary, dpi=DOTS, format="png")
