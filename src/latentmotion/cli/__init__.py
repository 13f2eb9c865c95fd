"""The command line, one file per verb."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Verb:
    """One command of the command line."""

    target: str
    """`file:class` in this folder: its fields are the options, its `run` does the job."""
    purpose: str
    """One line for the overview."""


VERBS = {
    "generate": Verb("generate:Generate", "Turn sentences or labels into motion files."),
    "set": Verb("states:ClipSet", "Make the clips of a state machine."),
    "bulk": Verb("bulk:Bulk", "Turn a file of prompts into many motions."),
    "clean": Verb("motions:Clean", "Clean up a motion: hold standing feet, remove jitter."),
    "edit": Verb("edit:EditMotion", "Generate a part of a motion anew."),
    "between": Verb("edit:Between", "Generate what leads from one motion to another."),
    "join": Verb("edit:Join", "Join motions one after the other, with transitions."),
    "teach": Verb("teach:Teach", "Show a model a movement: a clip and what it shows."),
    "fit": Verb("edit:Fit", "Turn keypoints of a tracker into a clean motion."),
    "render": Verb("render:Render", "Draw motion files as video, GIF or picture."),
    "search": Verb("search:Search", "Find motions in your own files by a sentence."),
    "nearest": Verb("search:Nearest", "Report the training clips nearest to a motion."),
    "retarget": Verb("motions:Retarget", "Retarget motions to your own character."),
    "blender-addon": Verb(
        "motions:BlenderAddon", "Write the add-on for Blender, ready to install."
    ),
    "web": Verb("pages:Web", "Write a static site that generates in the visitor's browser."),
    "data prepare cmu": Verb("data:PrepareCmu", "CMU's trials with HumanML3D's captions."),
    "data prepare hdm05": Verb("data:PrepareHdm05", "HDM05's clips and their classes."),
    "data prepare snu": Verb("data:PrepareSnu", "SNU's takes, cut and named."),
    "data prepare humanml3d": Verb("data:PrepareHumanML3D", "The official HumanML3D."),
    "data prepare kit": Verb("data:PrepareKit", "The official KIT-ML."),
    "data prepare humanact12": Verb(
        "data:PrepareHumanAct12", "HumanAct12 as ACTOR distributes it."
    ),
    "data prepare uestc": Verb("data:PrepareUestc", "UESTC as ACTOR distributes it."),
    "data prepare labelled": Verb("data:PrepareLabelled", "Your own files, one folder per action."),
    "data prepare own": Verb("data:PrepareOwn", "Your own files and captions."),
    "data prepare plugin": Verb("data:PreparePlugin", "What an installed plugin reads."),
    "data merge": Verb("data:Merge", "Join prepared folders into one training set."),
    "data pack": Verb("data:PackData", "Write a prepared folder as one small file."),
    "data unpack": Verb("data:UnpackData", "Write the prepared folder that a pack holds."),
    "data compose": Verb("data:Compose", "Join pairs of actions into sequences, for training."),
    "data describe": Verb("data:Describe", "Write captions measured from the motions."),
    "data check": Verb("data:CheckData", "List what a data folder holds and what it lacks."),
    "train vae": Verb("train:TrainVAE", "Train a motion VAE (stage 1)."),
    "train denoiser": Verb("train:TrainDenoiser", "Train the diffusion (stage 2)."),
    "train decoder": Verb("train:TrainDecoder", "Train a cheaper decoder for a model's latents."),
    "train reinforce": Verb("train:TrainReinforce", "Train a model on by its own motions."),
    "train distill": Verb("train:TrainDistill", "Distill a model to a few sampling steps."),
    "train text-encoder": Verb("train:TrainTextEncoder", "Distill a small sentence encoder."),
    "train length": Verb("train:TrainLength", "Train a predictor of a motion's length."),
    "train evaluator": Verb("train:TrainEvaluator", "Train the networks of FID and R-precision."),
    "train classifier": Verb("train:TrainClassifier", "Train an action classifier for evaluation."),
    "finetune": Verb("train:FineTune", "Teach a model the movements of your own clips."),
    "swap-decoder": Verb("export:SwapDecoder", "Give a model the decoder of another model."),
    "export": Verb("export:Export", "Make a trained model run without PyTorch."),
    "export scorer": Verb("export:ExportScorer", "Make a scorer of takes of an evaluator."),
    "evaluate": Verb("evaluate:Evaluate", "Measure a model."),
    "convert": Verb("convert:Convert", "Turn an MLD or MotionLCM checkpoint into a model."),
    "convert evaluator": Verb(
        "convert:ConvertEvaluator", "Turn an official evaluator into a folder."
    ),
    "experiment list": Verb(
        "experiment:ListExperiments", "List the paper's tables that can be run."
    ),
    "experiment run": Verb("experiment:RunExperiment", "Train and measure the rows of a table."),
    "experiment join": Verb(
        "experiment:JoinRuns", "Join runs of a table with other seeds or evaluators."
    ),
    "experiment document": Verb(
        "experiment:FillDocument", "Insert finished tables into a document."
    ),
    "serve": Verb("serve:Serve", "Serve motions over HTTP and WebSocket."),
    "mcp": Verb("serve:Mcp", "Serve an agent's tools over MCP."),
    "mmcp": Verb("serve:Mmcp", "Serve animation programs over MMCP."),
    "completion": Verb("usage:Completion", "Print what a shell needs to complete words."),
    "studio": Verb("serve:Studio", "Make, direct and export motions on a page of this machine."),
    "study make": Verb("pages:MakeStudy", "Make a page to compare two models, blind."),
    "study report": Verb("pages:ReportStudy", "Report what raters prefer."),
}
"""The command line. Only the verb that was typed is imported."""
