"""`latentmotion VERB …`: finds the verb; a user's mistake ends in one line and exit code 2."""

from __future__ import annotations

import os
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
    "data prepare cmu": Verb(f"{_CLI}.data:PrepareCmu", "CMU's trials, HumanML3D's captions."),
    "data prepare hdm05": Verb(f"{_CLI}.data:PrepareHdm05", "HDM05's clips and their classes."),
    "data prepare snu": Verb(f"{_CLI}.data:PrepareSnu", "SNU's takes, cut and named."),
    "data prepare humanml3d": Verb(f"{_CLI}.data:PrepareHumanML3D", "The official HumanML3D."),
    "data prepare kit": Verb(f"{_CLI}.data:PrepareKit", "The official KIT-ML."),
    "data prepare humanact12": Verb(
        f"{_CLI}.prepare_actions:PrepareHumanAct12", "HumanAct12 as ACTOR distributes it."
    ),
    "data prepare uestc": Verb(
        f"{_CLI}.prepare_actions:PrepareUestc", "UESTC as ACTOR distributes it."
    ),
    "data prepare labelled": Verb(
        f"{_CLI}.prepare_actions:PrepareLabelled", "Your own files, in a folder per action."
    ),
    "data prepare own": Verb(f"{_CLI}.data:PrepareOwn", "Your own files and captions."),
    "data merge": Verb(f"{_CLI}.data:Merge", "Join prepared folders into one training set."),
    "data pack": Verb(f"{_CLI}.data_pack:PackData", "Write a prepared folder as one small file."),
    "data unpack": Verb(f"{_CLI}.data_pack:UnpackData", "Write the folder that a pack holds."),
    "data compose": Verb(f"{_CLI}.compose:Compose", "Join two actions in a row, for training."),
    "data describe": Verb(f"{_CLI}.describe:Describe", "Write captions measured from the motions."),
    "data check": Verb(f"{_CLI}.data:Check", "Say what a data folder holds and what it lacks."),
    "train vae": Verb(f"{_CLI}.train:TrainVAE", "Train a motion VAE (stage 1)."),
    "train denoiser": Verb(f"{_CLI}.train:TrainDenoiser", "Train the diffusion (stage 2)."),
    "train decoder": Verb(
        f"{_CLI}.train_decoder:TrainDecoder", "Train a cheaper decoder for a model's latents."
    ),
    "train distill": Verb(f"{_CLI}.train_distill:TrainDistill", "Distill a model to few steps."),
    "train text-encoder": Verb(
        f"{_CLI}.train_text_encoder:TrainTextEncoder", "Distill a small sentence encoder."
    ),
    "train length": Verb(
        f"{_CLI}.train_length:TrainLength", "Train how long a sentence's motion is."
    ),
    "train evaluator": Verb(
        f"{_CLI}.train_evaluator:TrainEvaluator", "Train what FID and R-precision look through."
    ),
    "train classifier": Verb(
        f"{_CLI}.train_classifier:TrainClassifier", "Train a judge of actions for evaluation."
    ),
    "exchange": Verb(f"{_CLI}.exchange:Exchange", "Give a model the decoder of another."),
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

    Exit codes: 0 done, 2 a mistake of the user's (told on standard error), 130 interrupted, 141
    nobody reads on, as for any program whose pipe is closed.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            _run(words)
            print(end="", flush=True)  # unlike sys.stdout.flush, also where there is no stdout
    except LatentMotionError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        # Python flushes once more as it ends: into nothing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(141) from None


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
    name = next((" ".join(words[:n]) for n in (3, 2, 1) if " ".join(words[:n]) in VERBS), None)
    if name is None:
        _unknown(words)
        return
    from latentmotion.cli.usage import parsed

    module, _, cls = VERBS[name].target.partition(":")
    try:
        command = getattr(import_module(module), cls)
        parsed(command, name, words[len(name.split()) :]).run()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("latentmotion"):
            raise
        raise MissingExtraError(f"latentmotion {name}", error.name, "train") from error


def _unknown(words: list[str]) -> None:
    known = next((n for n in (2, 1) if n <= len(words) and _group(words[:n])), 0)
    group = _group(words[:known])
    if known and (len(words) == known or words[known] in ("-h", "--help")):
        print(_overview(group))
        return
    typed = " ".join(words[: known + 1])
    # One word further than what was understood, so that "xyz" is no reason to name every verb.
    names = dict.fromkeys(" ".join(name.split()[: known + 1]) for name in group)
    raise InputError(f"unknown command {typed!r}; {hint(typed, names)}")


def _group(words: list[str]) -> dict[str, Verb]:
    return {name: verb for name, verb in VERBS.items() if name.split()[: len(words)] == words}


def _overview(verbs: dict[str, Verb]) -> str:
    lines = [f"  {name:<25}{verb.purpose}" for name, verb in verbs.items()]
    usage = "usage: latentmotion COMMAND [OPTIONS]     (COMMAND --help tells its options)"
    return "\n".join([usage, "", *lines])
