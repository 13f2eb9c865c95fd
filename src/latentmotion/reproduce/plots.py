"""Figures: metrics by training, time against FID, guidance, bars, latents on their way.

z_T (noise) → … → z_t → … → z_0, recorded at the denoiser's calls, → two dimensions each
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from latentmotion.diffusion.samplers import trajectory
from latentmotion.engine.request import GenerationRequest, padded_batch
from latentmotion.errors import MissingExtraError
from latentmotion.evaluation.report import Figure
from latentmotion.pipeline import MotionPipeline, sampler_of
from latentmotion.reproduce.markdown import TableResult
from latentmotion.reproduce.table import Table
from latentmotion.storage.files import atomic_file

SIZE = (7.0, 4.5)  # Inches of a plot of one panel.

GUIDANCE_METRICS = ("FID", "R@3", "MM-Dist")  # Metrics that are drawn by guidance scale.

Points = Sequence[tuple[float, float]]


def draw_figure(table: Table, result: TableResult, path: Path) -> bool:
    """Draws the figure of a table, if it has one and its rows are measured.

    Args:
        table: The table.
        result: Measured rows.
        path: SVG to write.

    Returns:
        Whether there is a figure.
    """
    figures: dict[str, Mapping[str, float]] = {
        row.row: {name: pair[0] for name, pair in row.figures.items() if pair[0] is not None}
        for row in result.rows
    }
    rows = [row for row in table.rows if figures.get(row.name)]
    if table.figure == "training":
        curves: dict[str, dict[str, list[tuple[float, float]]]] = {}
        for row in (row for row in rows if row.share):
            for name, value in figures[row.name].items():
                if name in table.metrics:
                    points = curves.setdefault(name, {}).setdefault(row.title.partition(",")[0], [])
                    points.append((100 * (row.share or 0.0), value))
        return draw_curves(path, curves, "Epochs, % of the training")
    if table.figure == "bars":
        names = [n for n in ("FID", "Diversity") if any(n in figures[row.name] for row in rows)]
        bars = {name: {row.title: figures[row.name].get(name) for row in rows} for name in names}
        return draw_bars(path, bars)
    if table.figure == "time":
        series: dict[str, list[tuple[str, float, float]]] = {}
        for row in rows:
            measured = figures[row.name]
            seconds = measured.get("AITS", measured.get("Processor time"))
            if seconds is not None and "FID" in measured:
                # One line for the steps of a sampler, such as `MLD, DDIM 50`; else a point.
                method, _, label = row.title.partition(", ")
                sampler, _, steps = label.rpartition(" ")
                label, name = (
                    (label, f"{method} ({sampler})") if steps.isdigit() else ("", row.title)
                )
                series.setdefault(name, []).append((label, seconds, measured["FID"]))
        return time_against_fid(path, series)
    if table.figure == "guidance":
        rows = [row for row in rows if row.guidance]
        names = [n for n in GUIDANCE_METRICS if all(n in figures[row.name] for row in rows)]
        sweep = {
            name: {"": [(row.guidance or 0.0, figures[row.name][name]) for row in rows]}
            for name in (names if rows else ())
        }
        return draw_curves(path, sweep, "Guidance scale s")
    # The maps of latents are drawn with their row.
    return table.figure == "tsne" and path.is_file()


def draw_curves(path: Path, curves: Mapping[str, Mapping[str, Points]], xlabel: str) -> bool:
    """Draws metrics as curves, one panel each.

    Args:
        path: SVG to write.
        curves: For each metric its runs by name, as (x, value); a single run may have no name.
        xlabel: What x is.

    Returns:
        Whether there is a metric to draw.
    """
    if not curves:
        return False
    figure, panels = new_figure(columns=len(curves))
    for panel, (metric, runs) in zip(panels, curves.items(), strict=True):
        for name, points in runs.items():
            panel.plot(*zip(*points, strict=True), "o-", label=name or None)
        panel.set(xlabel=xlabel, ylabel=metric)
        panel.grid(alpha=0.3)
        if "" not in runs:
            panel.legend()
    return save_figure(figure, path)


def draw_bars(path: Path, bars: Mapping[str, Mapping[str, float | None]]) -> bool:
    """Draws a bar for each row, one panel for each metric.

    Args:
        path: SVG to write.
        bars: For each metric the value of each row; None if it was not measured.

    Returns:
        Whether there is a metric to draw.
    """
    if not bars:
        return False
    figure, panels = new_figure(columns=len(bars))
    for panel, (metric, rows) in zip(panels, bars.items(), strict=True):
        measured = {name: value for name, value in rows.items() if value is not None}
        drawn = panel.barh(list(measured), list(measured.values()))
        panel.bar_label(drawn, fmt="%.3g", padding=3, fontsize=8)
        panel.invert_yaxis()
        panel.margins(x=0.15)
        panel.set(xlabel=metric)
    return save_figure(figure, path)


def time_against_fid(path: Path, series: Mapping[str, Sequence[tuple[str, float, float]]]) -> bool:
    """Draws FID by seconds per motion.

    Args:
        path: SVG to write.
        series: For each method its (label, seconds, FID).

    Returns:
        Whether there is a method to draw.
    """
    if not series:
        return False
    figure, (panel,) = new_figure()
    for name, points in series.items():
        ordered = sorted(points, key=lambda point: point[1])
        panel.plot([p[1] for p in ordered], [p[2] for p in ordered], "o-", label=name)
        for label, x, y in ordered:
            panel.annotate(label, (x, y), xytext=(5, 5), textcoords="offset points", fontsize=8)
    panel.set(xlabel="Time per motion, s (one at a time)", ylabel="FID", xscale="log")
    panel.margins(x=0.15, y=0.12)
    panel.grid(alpha=0.3)
    # Below the panel, where it hides no point.
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    return save_figure(figure, path)


def latent_maps(
    path: Path, maps: Mapping[str, Float[np.ndarray, "items 2"]], labels: Sequence[str]
) -> None:
    """Draws t-SNE maps side by side, colored by action.

    Args:
        path: SVG to write.
        maps: Maps by title, e.g. `t = 981`.
        labels: The action of each item.
    """
    figure, panels = new_figure(columns=len(maps), width=3.4)
    actions = sorted(set(labels))
    for panel, (name, points) in zip(panels, maps.items(), strict=True):
        for number, action in enumerate(actions):
            chosen = np.array([label == action for label in labels])
            color = f"C{number % 10}"
            marker = "ox^sDvP*"[number // 10 % 8]
            panel.scatter(*points[chosen].T, s=9, color=color, marker=marker, label=action)
        panel.set(title=name, xlabel="t-SNE 1", xticks=[], yticks=[])
    panels[0].set_ylabel("t-SNE 2")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=6, fontsize=8, markerscale=2)
    save_figure(figure, path)


def new_figure(columns: int = 1, width: float | None = None) -> tuple[Any, list[Any]]:
    """Returns a figure and its panels side by side.

    Args:
        columns: Panels.
        width: Inches of each; by default 7 of a single one, 4.4 of several.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    try:
        # Not pyplot, which needs a display and keeps every figure.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise MissingExtraError("plots", "matplotlib", "train") from error
    inches = (columns * (width or (SIZE[0] if columns == 1 else 4.4)), SIZE[1])
    figure = Figure(figsize=inches, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(np.atleast_1d(figure.subplots(1, columns)))


def save_figure(figure: Any, path: Path) -> bool:
    """Writes a figure as SVG, the same bytes for the same figure; returns True."""
    import matplotlib as mpl

    # Text stays text, and the same figure is the same file.
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": path.stem}
    with atomic_file(path) as temporary, mpl.rc_context(style):
        figure.savefig(temporary, format="svg", metadata={"Date": None})
    return True


PER_LABEL = 30  # Motions of each action, as in the paper.

FRAMES = 60  # Length of the motions, as of the paper's action data.

CLEAN = -1.0  # Timestep that stands for latents without noise.


def draw_latents(generator: MotionPipeline, path: Path) -> dict[str, Figure]:
    """Draws the maps of a model of actions; returns the silhouettes of noise and latents."""
    labels = [label for label in generator.card.condition.labels for _ in range(PER_LABEL)]
    states = latents_along(generator, labels, min(FRAMES, generator.card.frames[1]))
    names = {t: f"t = {t:g}" for t, _ in states} | {CLEAN: "z₀"}
    latent_maps(path, {names[t]: map_of(z) for t, z in chosen(states)}, labels)
    return {
        "Silhouette of noise": Figure(silhouette(states[0][1], labels)),
        "Silhouette of latents": Figure(silhouette(states[-1][1], labels)),
    }


def latents_along(
    generator: MotionPipeline, labels: Sequence[str], frames: int
) -> list[tuple[float, Float[np.ndarray, "items numbers"]]]:
    """Samples a motion per label; returns the latents at each timestep, the last without noise.

    Args:
        generator: A model of actions with a global latent.
        labels: One per motion.
        frames: Length of the motions.
    """
    card = generator.card
    sampling = card.sampling.but(sampler="ddim")
    request = GenerationRequest(
        tuple(labels), (frames,) * len(labels), tuple(range(len(labels))), sampling
    )
    condition = generator.condition(labels)
    batch, noise = padded_batch(request, condition, card.latents, generator.backend)
    chain = generator.guided(sampling), sampler_of(card, sampling), batch.noise
    steps = trajectory(*chain, batch.condition, batch.tokens, sampling.steps, noise)
    states = [(t, generator.backend.to_host(z).reshape(len(z), -1)) for t, z in steps]
    return [*states[:-1], (CLEAN, states[-1][1])]


def chosen(
    states: Sequence[tuple[float, np.ndarray]], count: int = 5
) -> list[tuple[float, np.ndarray]]:
    """Returns `count` of the states, evenly spaced from the first to the last."""
    indices = np.linspace(0, len(states) - 1, count).round().astype(int)
    return [states[index] for index in indices]


def map_of(latents: Float[np.ndarray, "items numbers"]) -> np.ndarray:
    """Returns the t-SNE map (van der Maaten & Hinton 2008), (items, 2)."""
    try:
        from sklearn.manifold import TSNE
    except ModuleNotFoundError as error:
        raise MissingExtraError("t-SNE", "scikit-learn", "train") from error
    perplexity = min(30.0, (len(latents) - 1) / 3)
    tsne = TSNE(perplexity=perplexity, init="pca", random_state=0)
    return tsne.fit_transform(latents.astype(np.float32))


def silhouette(latents: Float[np.ndarray, "items numbers"], labels: Sequence[str]) -> float:
    """Returns the mean silhouette of items by label, −1 to 1 (Rousseeuw 1987)."""
    from sklearn.metrics import silhouette_score

    return float(silhouette_score(latents, list(labels)))
