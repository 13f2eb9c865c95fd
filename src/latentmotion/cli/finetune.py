"""`latentmotion finetune FOLDER -o MODEL`: teaches a model the movements of your own clips."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from latentmotion.cli import options
from latentmotion.data.clip import Source
from latentmotion.data.sources.own import OwnMotions
from latentmotion.model.card import CARD_FILE, find_model
from latentmotion.storage.files import check_replaceable
from latentmotion.training.distributed import distributed_context
from latentmotion.training.experiment import with_changes
from latentmotion.training.finetune import FineTuning, finetune


@dataclass(frozen=True)
class FineTune(options.ReadingOptions):
    """Teach a model the movements of your own clips: prepare, train, distill, export.

    The same command again resumes a stopped run, which is kept in OUTPUT.run.

    Example: latentmotion finetune my_clips -o my_model
    """

    folder: options.Folder
    """Folder of BVH, FBX, GLB, AMC, USD or NPZ files, nested in any way, with sentences in NAME.txt
    beside NAME.bvh; without any, the names of the files and what is measured become captions."""
    output: options.Output
    """Model folder to write."""
    captions: Path | None = None
    """CSV file with the columns file and caption, and optionally from, to (seconds), split."""
    model: str = "starter"
    """Name, run folder or model folder of the model to train on; not a distilled one."""
    few_steps: bool = True
    """Distill the result to 1, 2 and 4 sampling steps, as the default model is."""
    license: str = "unknown"
    """Terms under which the clips, and models trained on them, may be used."""
    credit: str = ""
    """Whom to credit."""
    set: options.Changes = ()
    """Change any other setting, e.g. training.steps=3000 or rehearsal=0; repeatable."""
    device: options.Device = options.AUTO

    def run(self) -> None:
        """Trains to the end and writes the model folder.

        Raises:
            DataError: No clip can be used.
            InputError: The output cannot be written, or its run is of other settings.
            ModelError: The model cannot be trained on.
        """
        check_replaceable(self.output, CARD_FILE)
        clips = OwnMotions(
            folder=self.folder,
            source=Source("own", self.license, self.credit),
            captions=self.captions,
            stated=self.stated(),
            test=0.0,
        )
        settings = with_changes(FineTuning(few_steps=self.few_steps), self.set)
        with distributed_context(self.device) as context:
            work = finetune(settings, clips, find_model(self.model), self.output, context)
        print(f"wrote {self.output} (what training left is in {work})")
        print(f'try: latentmotion generate "YOUR SENTENCE" --model {self.output} -o new.html')
