"""Model folders on the Hugging Face Hub: only what is asked for by its id is downloaded.

An id is `owner/name`, or `owner/name@revision` for a branch, tag or commit. Of a repository only
the files of a model folder are taken; none of them is unpickled. `HF_ENDPOINT` names another
server than huggingface.co, and `HF_TOKEN` a user; both as `huggingface_hub` documents them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from latentmotion.errors import MissingExtraError, ModelError

KNOWN_FILES = ("*.json", "*.onnx", "*.safetensors", "LICENSE*", "README.md")
"""Patterns of the files of a model folder: card, tokenizer, graphs, weights and what is said."""

_ID = re.compile(r"(?P<repository>\w[\w.-]*/\w[\w.-]*)(@(?P<revision>\w[\w./-]*))?", re.ASCII)


def is_hub_id(model: str | Path) -> bool:
    """Returns whether a model's name looks like `owner/name` and there is no such folder here."""
    return isinstance(model, str) and bool(_ID.fullmatch(model)) and not Path(model).exists()


def download(model: str) -> Path:
    """Downloads a model folder, or finds it in huggingface_hub's cache; returns the folder.

    Args:
        model: Its id, as `is_hub_id` knows it.

    Raises:
        MissingExtraError: `huggingface_hub` is not installed.
        ModelError: There is no such model on the hub, or the hub cannot be reached.
    """
    try:
        from huggingface_hub import snapshot_download
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"the model {model!r} on the hub", "huggingface_hub", "hub"
        ) from error
    found = _ID.fullmatch(model)
    assert found is not None  # the caller asked `is_hub_id`
    repository, revision = found["repository"], found["revision"]
    endpoint = os.environ.get("HF_ENDPOINT")
    try:
        folder = snapshot_download(
            repository,
            revision=revision,
            allow_patterns=list(KNOWN_FILES),
            ignore_patterns="*/*",
            endpoint=endpoint,
        )
    except Exception as error:  # that library's errors, and those of the one it calls the net by
        raise ModelError(
            f"no model {model!r}: there is no such folder here, and from the hub it cannot be "
            f"downloaded: {error}"
        ) from error
    return Path(folder)
