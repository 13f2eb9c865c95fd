"""Adds word pieces to the text encoder that ships, from the teacher that it was distilled from.

    python data/pieces.py src/latentmotion/models/starter data/words.txt data/phrases.tsv.xz

A student keeps its teacher's piece embeddings almost as they are (cosine .99), so rows of the
teacher are read among its own: sentences with a word that it had read by syllables are then at a
cosine of .94 from the teacher's embedding, .73 before. All others are embedded as before, so the
encoder keeps its name, and models, indexes and movements that people taught stay valid. Words of
the texts that stay in several pieces count as known: the index of these texts knows them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch
import tyro
from onnx import numpy_helper
from tokenizers import Tokenizer

from latentmotion.engine.encoder import split_words
from latentmotion.model.card import TEXT_GRAPH_FILE, TOKENIZER_FILE
from latentmotion.networks.pretrained_text import PretrainedTextEncoder
from latentmotion.networks.text_encoder import pack
from latentmotion.storage.files import atomic_file
from latentmotion.storage.reading import read_text, unpack_xz


@dataclass(frozen=True)
class Pieces:
    """Add the pieces that some texts need."""

    folder: tyro.conf.Positional[Path]  # Folder of the model.
    texts: tyro.conf.Positional[tuple[Path, ...]]  # Texts, packed by xz where the name ends so.

    def run(self) -> None:
        """Writes both files."""
        teacher = PretrainedTextEncoder.load("minilm")
        large = Tokenizer.from_str(teacher.tokenizer.backend_tokenizer.to_str())
        large.no_truncation()
        settings = json.loads((self.folder / TOKENIZER_FILE).read_text(encoding="utf-8"))
        vocabulary, order = settings["model"]["vocab"], large.get_vocab()
        count, lines = len(vocabulary), list[str]()
        for file in self.texts:
            text = unpack_xz(file).decode() if file.suffix == ".xz" else read_text(file)
            lines += text.replace("|", "\n").splitlines()
        used = {piece for encoding in large.encode_batch(lines) for piece in encoding.tokens}
        pieces = sorted(used - vocabulary.keys(), key=order.__getitem__)
        vocabulary |= {piece: count + number for number, piece in enumerate(pieces)}
        rows = teacher.model.get_input_embeddings().weight[[order[piece] for piece in pieces]]
        graph = onnx.load(self.folder / TEXT_GRAPH_FILE)
        added = {kind.numpy().dtype: kind.numpy() for kind in pack(rows.detach().to(torch.float32))}
        for tensor in graph.graph.initializer:
            if tensor.dims and tensor.dims[0] == count:  # the table in 8 bits, and its scales
                table = numpy_helper.to_array(tensor)
                table = np.concatenate([table, added[table.dtype]])
                tensor.CopyFrom(numpy_helper.from_array(table, tensor.name))
        small = Tokenizer.from_str(json.dumps(settings))
        card = next(entry for entry in graph.metadata_props if entry.key == "known_words")
        split = (word for line in lines for word in split_words(small, line))
        card.value = json.dumps(sorted({*json.loads(card.value), *split}))
        with atomic_file(self.folder / TEXT_GRAPH_FILE) as temporary:
            onnx.save(graph, temporary)
        with atomic_file(self.folder / TOKENIZER_FILE) as temporary:
            small.save(str(temporary), pretty=False)
        print(f"{len(pieces)} pieces added, {len(vocabulary)} in all")


if __name__ == "__main__":
    tyro.cli(Pieces).run()
