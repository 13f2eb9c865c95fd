"""Trains the motion tower of the own-clip retrieval, and nothing else.

    python -m benchmarks.quality.own_clip.train data/starter.pack

Its text side is a bag of words and pairs of neighboring words that is thrown away after: no
encoder, scorer, detector or model of this repository is behind the ruler. It sees one half of the
captions (`words.is_trained_on`), with clips drawn by the rarity of the words that name them.
"""

from __future__ import annotations

import time
import zlib
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from torch import Tensor, nn

from benchmarks.quality.own_clip.tower import CHANNELS, LONGEST, WEIGHTS, WIDTH, Tower
from benchmarks.quality.own_clip.words import clips_naming, content_words, is_trained_on
from latentmotion.data.dataset import Dataset, Item, items_of

BUCKETS = 8192  # Rows of the table of words and pairs.

# Batches that are drawn together and shared out by length, which then tells nothing apart.
POOL = 8


@dataclass(frozen=True)
class Train:
    """Settings."""

    data: tyro.conf.Positional[Path]  # Prepared folder or pack.
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = WEIGHTS  # Weights to write.
    steps: int = 1200  # Steps.
    batch: int = 128  # Clips a step.
    learning_rate: float = 2e-3  # Highest rate; it falls as a cosine.
    temperature: float = 0.1  # Of the contrast.
    seed: int = 32_001  # Of weights and draws.
    # A clip of the rarest words is drawn this many times as often as one of the commonest.
    cap: float = 8.0


class Bag(nn.Module):
    """Captions to unit vectors."""

    def __init__(self) -> None:
        super().__init__()
        self.table = nn.EmbeddingBag(BUCKETS, WIDTH, mode="mean")
        self.layers = nn.Sequential(
            nn.Linear(WIDTH, 2 * WIDTH), nn.GELU(), nn.Linear(2 * WIDTH, WIDTH)
        )

    def forward(self, captions: list[str]) -> Tensor:
        """Returns a vector for each."""
        bags = [hashed(caption) for caption in captions]
        offsets = torch.tensor([0, *np.cumsum([len(bag) for bag in bags])[:-1].tolist()])
        pooled = self.table(torch.tensor([row for bag in bags for row in bag]), offsets)
        return nn.functional.normalize(pooled + self.layers(pooled), dim=-1)


def hashed(caption: str) -> list[int]:
    """Returns the rows of a caption's content words and of pairs that follow each other."""
    words = content_words(caption) or [""]
    pairs = (" ".join(pair) for pair in pairwise(words))
    return [zlib.crc32(each.encode()) % BUCKETS for each in (*words, *pairs)]


def main(settings: Train) -> None:
    """Trains and writes the weights."""
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)
    generator = np.random.default_rng(settings.seed)
    dataset = Dataset.load(settings.data)
    clips = [clip for clip in dataset.clips("train", mirrored=True) if clip.frames >= 12]
    items = [
        Item(item.clip, item.start, item.end, told)
        for item in items_of(clips)
        if (told := tuple(filter(is_trained_on, item.captions))) and item.frames >= 12
    ]
    features = {
        clip.id: dataset.features(clip)[:, CHANNELS].astype(np.float16)
        for clip in {item.clip.id: item.clip for item in items}.values()
    }
    counts = clips_naming(dataset.clips("train"))
    rare = [
        np.mean([min((counts[w] or 1 for w in content_words(c)), default=1000) for c in i.captions])
        for i in items
    ]
    odds = np.clip((1000 / np.array(rare)) ** 0.5, 1, settings.cap)
    odds /= odds.sum()
    tower, bag = Tower(), Bag()
    normalizer = dataset.normalizer
    tower.mean.copy_(torch.from_numpy(normalizer.mean[CHANNELS]))
    tower.std.copy_(torch.from_numpy(normalizer.std[CHANNELS]))
    weights = [*tower.parameters(), *bag.parameters()]
    optimizer = torch.optim.AdamW(weights, settings.learning_rate, weight_decay=0.02)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, settings.steps, pct_start=0.08
    )
    began, pool, order = time.process_time(), items[:0], np.arange(POOL)
    for step in range(settings.steps):
        if step % POOL == 0:
            rows = generator.choice(len(items), POOL * settings.batch, replace=False, p=odds)
            pool = sorted((items[row] for row in rows), key=lambda item: min(item.frames, LONGEST))
            order = generator.permutation(POOL)
        start = order[step % POOL] * settings.batch
        drawn = pool[start : start + settings.batch]
        captions = [str(generator.choice(item.captions)) for item in drawn]
        x, mask = crops(drawn, features, generator)
        texts, motions = bag(captions), tower(x, mask)
        scores = texts @ motions.T / settings.temperature
        bags = [frozenset(content_words(c)) for c in captions]
        same = torch.tensor([[a == b for a in bags] for b in bags])
        loss = -sum(
            torch.logsumexp(s.log_softmax(1).masked_fill(~same, -torch.inf), 1).mean()
            for s in (scores, scores.T)
        )
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(weights, 1.0)
        optimizer.step()
        schedule.step()
        if step % 50 == 0 or step == settings.steps - 1:
            print(f"{step} {loss.item():.3f} {time.process_time() - began:.0f} s", flush=True)
            tower.save(settings.output)


def crops(
    items: list[Item], features: dict[str, np.ndarray], generator: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Returns a window of each item, of at least 0.7 of it or the longest, and their mask."""
    windows = []
    for item in items:
        most = min(item.frames, LONGEST)
        frames = max(int(most * generator.uniform(0.7, 1)) // 4 * 4, 8)
        start = item.start + int(generator.integers(item.frames - frames + 1))
        windows.append(features[item.clip.id][start : start + frames])
    x = torch.zeros(len(items), max(map(len, windows)), len(CHANNELS))
    mask = torch.zeros(x.shape[:2], dtype=torch.bool)
    for row, window in enumerate(windows):
        x[row, : len(window)], mask[row, : len(window)] = torch.from_numpy(window).float(), True
    return x, mask


if __name__ == "__main__":
    main(tyro.cli(Train))
