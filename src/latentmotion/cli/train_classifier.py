"""`latentmotion train classifier`: a judge of actions for any labelled data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class TrainClassifier:
    """Trains an action classifier for evaluation and writes it to OUTPUT/model.

    The same command again goes on where a killed run was.
    """

    data: Path
    """Folder that `latentmotion data prepare` made, with action labels."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Run folder; one that exists is gone on with."""
    mirrored_classes: bool = False
    """Make labels that only mirrored copies have classes of their own (HDM05: kicks with the right
    foot). Without it such copies are left out."""
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Change one setting, e.g. training.steps=3000; may be given several times."""
    device: str = "auto"
    """auto, cpu, cuda or cuda:N."""

    def run(self) -> None:
        """Trains until done; prints the folder and the accuracies."""
        from latentmotion.evaluation.extractors.action_classifier import describe_action_classifier
        from latentmotion.experiment import with_changes
        from latentmotion.training.classifier import train_classifier
        from latentmotion.training.classifier_stage import ClassifierExperiment
        from latentmotion.training.devices import training_place

        experiment = ClassifierExperiment(mirrored_classes=self.mirrored_classes)
        experiment = with_changes(experiment, self.set)
        with training_place(self.device) as place:
            folder = train_classifier(experiment, self.data, self.output, place)
            about = describe_action_classifier(folder) if place.leads else None
        print(folder)
        for name, value in about.figures.items() if about else ():
            print(f"{name} {value:.3f}")
