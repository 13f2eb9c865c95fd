"""`latentmotion teach`: clips and sentences that motions may start from, without training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from latentmotion import formats
from latentmotion.cli import options
from latentmotion.data.clip import Caption, Source
from latentmotion.data.dataset import Dataset
from latentmotion.data.store import MANIFEST
from latentmotion.errors import InputError
from latentmotion.model.card import DEFAULT, MOVES_FILE
from latentmotion.motion import features_of
from latentmotion.pipeline import MotionPipeline
from latentmotion.retrieval import wordings
from latentmotion.retrieval.index import index_file, joined
from latentmotion.retrieval.teach import ShownClip, build_index, shown_clips, thinned
from latentmotion.storage.files import check_writable


@dataclass(frozen=True)
class Teach:
    """Teach a model a movement by showing it: a clip and sentences that say what it shows.

    Nothing is trained. The clip goes into a folder of moves, which generate takes by --moves; a
    sentence near one of these then starts from the clip. The same folder takes any number of clips.

    Example: latentmotion teach robot.bvh "a person does the robot dance" -o my_moves
    Example: latentmotion teach my_data -o my_moves, for all training clips of prepared data
    """

    file: Annotated[Positional[Path], arg(metavar="CLIP", help=options.MOTION_FILE)]
    sentences: Annotated[Positional[tuple[str, ...]], arg(metavar="SENTENCES")] = ()
    """What the person in the clip does, in one or several wordings; prepared data has captions."""
    wordings: tuple[Path, ...] = ()
    """Files of captions in the words that people type, a line each: `CAPTION<tab>WORDS|WORDS`."""
    output: Annotated[Path, arg(aliases=["-o"])] = Path("my_moves")
    """Folder of moves; one that is there gets further clips."""
    compact: bool = False
    """Keep sentences in a sixth of the bytes, as clips that ship with a model do; two such sets
    cannot be used together."""
    between: tuple[float, float] | None = None
    """The part of the clip that shows it, seconds; by default all of it."""
    model: str = DEFAULT
    """Name or folder of the model that is to make it."""
    credit: str = ""
    """Whom files of such motions credit."""
    license: str = "unknown"
    """Terms under which motions that start from the clip may be used."""

    def run(self) -> None:
        """Reads the clip, writes the folder.

        Raises:
            InputError: The file cannot be read as a motion of a person, it is too short, there is
                no sentence, or the model cannot start from clips.
            ModelError: The folder's file is damaged, or of another model.
        """
        prepared = self.file.suffix == ".pack" or (self.file / MANIFEST).is_file()
        if prepared:
            reason = f"{self.file} has clips, captions, owners and terms of its own"
            options.refuse_unused(self, reason, "sentences", "between", "credit", "license")
        else:
            options.refuse_unused(self, f"{self.file} is no prepared data", "wordings", "compact")
        if not prepared and not any(text.strip() for text in self.sentences):
            raise InputError(
                'a clip needs a sentence that says what it shows: latentmotion teach clip.bvh "a '
                'person does the robot dance"'
            )
        target = self.output / MOVES_FILE
        check_writable(target if self.output.exists() else self.output)
        pipeline = MotionPipeline.from_pretrained(self.model)
        space, encoder = pipeline.representation, pipeline.text_encoder
        encoders = pipeline.feature_encoder, encoder
        if not prepared:
            owner, clips = self.credit or self.output.resolve().name, []
            for number, motion in enumerate(formats.load(self.file)):
                features = features_of(motion, space)
                if self.between:
                    start, end = (round(time * space.fps) for time in self.between)
                    if not 0 <= start < end <= len(features) + 1:
                        raise InputError(
                            f"--between {self.between[0]:g} {self.between[1]:g}: the clip lasts "
                            f"{len(features) / space.fps:.1f} s"
                        )
                    features = features[start:end]
                name = self.file.stem + (f"-{number + 1}" if number else "")
                captions = tuple(Caption(text.strip(), 0, len(features)) for text in self.sentences)
                clips.append(ShownClip(name, owner, self.file.name, features, captions))
            source = Source(owner, self.license, self.credit)
            index = build_index(clips, [source], pipeline.card, *encoders).preferred()
        else:
            dataset = Dataset.load(self.file)
            index = build_index(shown_clips(dataset), dataset.sources, pipeline.card, *encoders)
            index = thinned(index)
            if self.wordings:
                texts = wordings.read_wordings(self.wordings)
                index = wordings.with_wordings(index, texts, encoder)
        if target.exists():
            earlier = joined([index_file(self.output)], index.latent_space, index.text_encoder)
            index = earlier.joined(index)
        if self.compact:
            index = wordings.distinct(wordings.along_discriminants(index))
        self.output.mkdir(exist_ok=True)
        index.write(target)
        print(f"wrote {target}: {len(index.clips)} clips, {len(index.captions)} sentences")
        sentence = self.sentences[0] if self.sentences else index.captions[0].text
        print(f'try: latentmotion generate "{sentence}" --moves {self.output}')
