"""Model folders: those that ship with the package, and how a model is found by name."""

from __future__ import annotations

from pathlib import Path

from latentmotion.errors import ModelError, hint
from latentmotion.model.card import CARD_FILE

DEFAULT = "fast"
"""The model that generates where none is named: `starter`, distilled to few steps."""


_SHIPPED = Path(__file__).parents[1] / "models"
"""Where the shipped models are, each a folder."""


def shipped_models() -> tuple[str, ...]:
    """Returns the names of the models inside the package."""
    # A folder that begins with a dot is still being written.
    return tuple(sorted(c.parent.name for c in _SHIPPED.glob(f"[!.]*/{CARD_FILE}")))


def find_model(model: str | Path) -> Path:
    """Returns the folder of a model, given a name such as `starter`, a folder or a run folder.

    Raises:
        ModelError: There is no such model; the message names the nearest.
    """
    if str(model) in shipped_models():
        return _SHIPPED / str(model)
    if Path(model).is_dir():
        inside = Path(model) / "model"  # where a training run puts it
        return inside if (inside / CARD_FILE).is_file() else Path(model)
    told = hint(str(model), shipped_models())
    raise ModelError(f"no model {str(model)!r}, neither by name nor as a folder; {told}")
