"""Clips of a pack as a Hugging Face dataset and as Parquet (pip install datasets pandas).

python examples/tables.py data/starter.pack clips.parquet train
"""

import sys
from collections.abc import Iterator

import datasets

from latentmotion import Dataset


def rows(pack: str, split: str, most: int) -> Iterator[dict]:
    """Yields clips: name, captions, rate, joints (frames, 22, 3) in meters."""
    data = Dataset.load(pack)
    for clip in data.clips(split)[:most]:
        joints = data.representation.decode(data.features(clip)).astype("f4")
        captions = [caption.text for caption in clip.captions]
        yield {"clip": clip.id, "captions": captions, "fps": 20.0, "joints": joints.tolist()}


def main(pack: str, output: str, split: str = "train", most: str = "100") -> None:
    """Writes the first clips of a split; pandas reads the file again."""
    # Not from_generator, which would answer from its cache when the folder has changed.
    table = datasets.Dataset.from_list(list(rows(pack, split, int(most))))
    table.to_parquet(output)
    print(f"wrote {output}: {table.num_rows} clips")


if __name__ == "__main__":
    main(*sys.argv[1:])
