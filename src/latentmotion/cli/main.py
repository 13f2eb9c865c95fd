"""`latentmotion VERB …`: finds the verb; a user's mistake ends in one line and exit code 2."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module

from latentmotion import __version__
from latentmotion.errors import InputError, LatentMotionError, MissingExtraError, hint


@dataclass(frozen=True)
class Verb:
    """One command of the command line."""

    target: str
    """`module:class` of the dataclass whose fields are its options and whose `run` does the job."""
    purpose: str
    """One line for the overview."""


_CLI = "latentmotion.cli"

VERBS = {
    "generate": Verb(f"{_CLI}.generate:Generate", "Turn sentences or labels into motion files."),
    "clean": Verb(f"{_CLI}.clean:Clean", "Hold the feet of a motion and steady it."),
    "render": Verb(f"{_CLI}.render:Render", "Draw motion files as video, GIF or picture."),
    "blender-addon": Verb(
        f"{_CLI}.blender_addon:BlenderAddon", "Write the add-on for Blender, ready to install."
    ),
    "retarget": Verb(f"{_CLI}.retarget:Retarget", "Carry motions to a character of your own."),
    "data prepare": Verb(f"{_CLI}.data:Prepare", "Make a training set from mocap and captions."),
    "data merge": Verb(f"{_CLI}.data:Merge", "Join prepared folders into one training set."),
    "data check": Verb(f"{_CLI}.data:Check", "Say what a data folder holds and what it lacks."),
    "train vae": Verb(f"{_CLI}.train:TrainVAE", "Train a motion VAE (stage 1)."),
    "train denoiser": Verb(f"{_CLI}.train:TrainDenoiser", "Train the diffusion (stage 2)."),
    "train distill": Verb(f"{_CLI}.train_distill:TrainDistill", "Distill a model to few steps."),
    "train text-encoder": Verb(
        f"{_CLI}.train_text_encoder:TrainTextEncoder", "Distill a small sentence encoder."
    ),
    "train evaluator": Verb(
        f"{_CLI}.train_evaluator:TrainEvaluator", "Train what FID and R-precision look through."
    ),
    "train classifier": Verb(
        f"{_CLI}.train_classifier:TrainClassifier", "Train a judge of actions for evaluation."
    ),
    "export": Verb(f"{_CLI}.export:Export", "Make a trained model run without PyTorch."),
    "evaluate": Verb(f"{_CLI}.evaluate:Evaluate", "Measure a model for its card."),
    "convert evaluator": Verb(
        f"{_CLI}.convert_evaluator:ConvertEvaluator", "Turn an official evaluator into a folder."
    ),
    "convert": Verb(f"{_CLI}.convert:Convert", "Turn the MLD authors' checkpoint into a model."),
    "experiment list": Verb(
        f"{_CLI}.experiment:ListExperiments", "Say which tables of the paper can be run."
    ),
    "experiment document": Verb(
        f"{_CLI}.experiment:FillDocument", "Put tables that were run into a document."
    ),
    "experiment run": Verb(
        f"{_CLI}.experiment:RunExperiment", "Train and measure the rows of a table."
    ),
    "study make": Verb(
        f"{_CLI}.study:MakeStudy", "Make a page on which people compare two models, blind."
    ),
    "study report": Verb(f"{_CLI}.study:ReportStudy", "Say what they preferred."),
}
"""The command line. Only the verb that was typed is imported."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line.

    Exit codes: 0 done, 2 a mistake of the user's (told on standard error), 130 interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            _run(words)
    except LatentMotionError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _run(words: list[str]) -> None:
    if not words or words[0] in ("-h", "--help"):
        print(_overview(VERBS))
    elif words[0] == "--version":
        print(f"latentmotion {__version__}")
    else:
        _run_verb(words)


def _run_verb(words: list[str]) -> None:
    name = next((" ".join(words[:n]) for n in (2, 1) if " ".join(words[:n]) in VERBS), None)
    if name is None:
        _unknown(words)
        return
    import tyro

    module, _, cls = VERBS[name].target.partition(":")
    try:
        command = getattr(import_module(module), cls)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("latentmotion"):
            raise
        raise MissingExtraError(f"latentmotion {name}", error.name, "train") from error
    rest = words[len(name.split()) :]
    tyro.cli(command, prog=f"latentmotion {name}", args=rest).run()


def _unknown(words: list[str]) -> None:
    group = {name: verb for name, verb in VERBS.items() if name.split()[0] == words[0]}
    if group and (len(words) == 1 or words[1] in ("-h", "--help")):
        print(_overview(group))
        return
    typed = " ".join(words[: 2 if group else 1])
    raise InputError(f"unknown command {typed!r}; {hint(typed, VERBS)}")


def _overview(verbs: dict[str, Verb]) -> str:
    lines = [f"  {name:<20}{verb.purpose}" for name, verb in verbs.items()]
    usage = "usage: latentmotion COMMAND [OPTIONS]     (COMMAND --help tells its options)"
    return "\n".join([usage, "", *lines])
