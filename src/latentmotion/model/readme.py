"""A model's page on the Hugging Face Hub: README.md, written from its card."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from latentmotion.model.card import RIGHTS_IN_MOTIONS, ModelCard
from latentmotion.storage.provenance import PIPELINE, front_matter, license_fields

_INPUTS = {
    "text": "an English sentence",
    "action": "the name of an action",
    "unconditional": "nothing but a seed",
}


def readme(card: ModelCard) -> str:
    """Returns the page, with the YAML that the hub reads at its head."""
    provenance, text = card.provenance, card.task == "text"
    head = {
        **license_fields([provenance.license]),
        "library_name": "latentmotion",
        "pipeline_tag": PIPELINE if text else None,
        "language": ["en"] if text else None,
        "tags": ["latentmotion", "text-to-motion" if text else "motion-generation", "motion"],
        "datasets": [line.partition(":")[0] for line in provenance.data],
        "model-index": _index(card),
    }
    shortest, longest = card.frames
    prompt = '"a person walks"' if text else '"LABEL"' if card.task == "action" else "None"
    rows = [f"| {name} | {value:g} |" for name, value in numbers(card.figures)]
    lines = [
        front_matter(head),
        f"# {card.name}",
        "",
        f"Makes motion of one person from {_INPUTS[card.task]}: {shortest} to {longest} frames of "
        f"{card.representation} features, with {card.sampling.steps} sampling steps of "
        f"{card.sampling.sampler} where nothing else is asked. `model.json` holds the same for "
        "programs.",
        "",
        "```python",
        "from latentmotion import MotionPipeline",
        "",
        'generate = MotionPipeline.from_pretrained("FOLDER_OR_HUB_ID")',
        f'generate({prompt}, seed=7).save("motion.bvh")',
        "```",
        "",
        "## Training",
        "",
        *(f"* Data: {line}" for line in provenance.data),
        *(f"* SHA-256 of {name}: {value}" for name, value in provenance.data_hashes.items()),
        f"* {provenance.hours:g} hours on {provenance.machine or 'an unknown machine'}",
        *(["", "```bash", *provenance.commands, "```", ""] if provenance.commands else [""]),
        "## Figures",
        "",
        *(["| figure | value |", "|---|---|", *rows] if rows else ["None were measured."]),
        "",
        "## Terms",
        "",
        f"Weights: {provenance.license}. {RIGHTS_IN_MOTIONS}",
        "",
    ]
    return "\n".join(lines)


def _index(card: ModelCard) -> list[dict[str, Any]]:
    """Returns the hub's table of results; none for a model without figures."""
    evaluation = card.figures.get("evaluation", {})
    data = str(evaluation.get("data", ""))
    metrics = [
        {"type": name.rpartition(".")[2], "name": name, "value": value}
        for name, value in numbers(card.figures)
    ]
    result = {
        "task": {"type": PIPELINE, "name": "Motion generation"},
        "dataset": {
            "type": data.partition(" ")[0] or "motion-capture",
            "name": data or "the validation split of its training data",
        },
        "metrics": metrics,
    }
    return [{"name": card.name, "results": [result]}] if metrics else []


def numbers(figures: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, float]]:
    """Yields the numbers of nested figures with their names, joined by dots."""
    for name, value in figures.items():
        if isinstance(value, Mapping):
            yield from numbers(value, f"{prefix}{name}.")
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield f"{prefix}{name}", value
