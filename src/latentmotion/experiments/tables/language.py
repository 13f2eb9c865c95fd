"""Language models (paper, appendix): what reads the sentences."""

from __future__ import annotations

from latentmotion.experiments import published
from latentmotion.experiments.table import Row, Table
from latentmotion.experiments.tables.text import METRICS

LANGUAGE = Table(
    name="language",
    title="Language models",
    where="appendix",
    metrics=METRICS[:6],
    data="any text-motion data set; encoders from the hub, or from folders with --text-encoders",
    rows=(
        Row("real", "Real", "real"),
        Row("clip", "CLIP, pooled", model="clip_pooled", paper=published.HUMANML3D["mld"]),
        Row("clip_words", "CLIP, words", model="clip_words"),
        Row("bert", "DistilBERT, words", model="bert"),
        Row("minilm", "MiniLM, pooled", model="minilm"),
        Row("ours", "The encoder that is named, pooled", model="mld_1"),
    ),
)
