"""Folders that Godot 4 and Unity import without a click: settings and a script beside the figure.

Godot reads `.import` files beside its assets, so loops are loops at once; the scene moves by the
root motion. Unity asks the scripts of a project how a model is imported, when they are compiled.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from latentmotion.storage.files import atomic_file

Clip = Mapping[str, Any]
"""An entry of a set's table: state, loop, seconds, events."""

_GODOT_SCRIPT = """extends CharacterBody3D
## Plays the clips of $NAME.glb and moves by their root motion; written by Latent Motion.

signal foot(event: String)  # left_foot_down, left_foot_up, right_foot_down, right_foot_up

const ROOT := $ROOT
const EVENTS := $EVENTS

@export var state := $FIRST
@export var fade := 0.3

var last := 0.0

@onready var player: AnimationPlayer = $Figure.find_children("*", "AnimationPlayer")[0]


func _ready() -> void:
	var skeleton: Node = $Figure.find_children("*", "Skeleton3D")[0]
	var path := player.get_node(player.root_node).get_path_to(skeleton)
	if ROOT != "":
		player.root_motion_track = NodePath("%s:%s" % [path, ROOT])
	player.callback_mode_process = AnimationMixer.ANIMATION_CALLBACK_MODE_PROCESS_PHYSICS
	player.play(state)


## Changes to another clip.
func change(to: String) -> void:
	state = to
	player.play(to, fade)


func _physics_process(delta: float) -> void:
	quaternion = quaternion * player.get_root_motion_rotation()
	var facing := player.get_root_motion_rotation_accumulator().inverse() * quaternion
	velocity = facing * player.get_root_motion_position() / delta
	move_and_slide()
	var now := player.current_animation_position
	for event in EVENTS.get(String(player.current_animation), []):
		var at: float = event[0]
		if (at > last and at <= now) or (now < last and (at > last or at <= now)):
			foot.emit(event[1])
	last = now
"""

_GODOT_SCENE = """[gd_scene load_steps=4 format=3]

[ext_resource type="Script" path=$SCRIPT id="1"]
[ext_resource type="PackedScene" path=$FIGURE id="2"]

[sub_resource type="CapsuleShape3D" id="3"]
radius = 0.3
height = 1.8

[node name=$NAME type="CharacterBody3D"]
script = ExtResource("1")

[node name="Shape" type="CollisionShape3D" parent="."]
transform = Transform3D(1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0.9, 0)
shape = SubResource("3")

[node name="Figure" parent="." instance=ExtResource("2")]
"""

_GODOT_IMPORT = """[remap]

importer="scene"
importer_version=1

[params]

animation/import=true
animation/fps=$FPS
animation/trimming=false
_subresources=$SETTINGS
"""

_UNITY_SCRIPT = """// How Unity imports $NAME.fbx; written by Latent Motion.
using System.Linq;
using UnityEditor;
using UnityEngine;

class $CLASS : AssetPostprocessor
{
    class Known
    {
        public string name;
        public bool loops;
        public float[] times;
        public string[] what;
    }

    static readonly Known[] Clips =
    {
$CLIPS
    };

    bool Ours => assetPath.EndsWith("/" + $FILE);

    void OnPreprocessModel()
    {
        if (!Ours) return;
        var model = (ModelImporter)assetImporter;
        model.animationType = ModelImporterAnimationType.Generic;
        model.avatarSetup = ModelImporterAvatarSetup.CreateFromThisModel;
    }

    void OnPreprocessAnimation()
    {
        if (!Ours) return;
        var model = (ModelImporter)assetImporter;
        model.motionNodeName = model.transformPaths.FirstOrDefault(
            path => path == $ROOT || path.EndsWith("/" + $ROOT)) ?? "";
        var clips = model.defaultClipAnimations;
        foreach (var clip in clips)
        {
            var take = clip.takeName.Substring(clip.takeName.LastIndexOf('|') + 1);
            var known = Clips.FirstOrDefault(one => one.name == take);
            if (known == null) continue;
            clip.name = take;
            clip.loopTime = known.loops;
            clip.events = known.times.Select((time, n) => new AnimationEvent
            {
                time = time,
                functionName = "OnFoot",
                stringParameter = known.what[n],
                messageOptions = SendMessageOptions.DontRequireReceiver,
            }).ToArray();
        }
        model.clipAnimations = clips;
    }
}
"""


def write_godot(figure: Path, clips: Sequence[Clip], root: str, fps: float) -> list[Path]:
    """Writes what Godot 4 needs beside a `.glb`: import settings, a scene, its script.

    Args:
        figure: The `.glb`.
        clips: Entries of the set's table.
        root: Name of the bone that carries the root motion; empty for none.
        fps: Frames per second of the clips.
    """
    loops = {clip["state"]: {"settings/loop_mode": 1} for clip in clips if clip["loop"]}
    events = {
        clip["state"]: [[round(event["time"], 4), event["event"]] for event in clip["events"]]
        for clip in clips
    }
    script = figure.with_suffix(".gd")
    return [
        _written(
            figure.with_name(figure.name + ".import"),
            _GODOT_IMPORT,
            FPS=f"{fps:g}",
            SETTINGS=json.dumps({"animations": loops}, indent=0),
        ),
        _written(
            script,
            _GODOT_SCRIPT,
            NAME=figure.stem,
            ROOT=json.dumps(root),
            EVENTS=json.dumps(events),
            FIRST=json.dumps(clips[0]["state"]),
        ),
        _written(
            figure.with_suffix(".tscn"),
            _GODOT_SCENE,
            SCRIPT=json.dumps(script.name),
            FIGURE=json.dumps(figure.name),
            NAME=json.dumps(figure.stem),
        ),
    ]


def write_unity(figure: Path, clips: Sequence[Clip], root: str) -> list[Path]:
    """Writes what Unity needs beside an `.fbx`: a script of the editor that sets its import.

    Args:
        figure: The `.fbx`.
        clips: Entries of the set's table.
        root: Name of the bone that carries the root motion; empty for none.
    """
    rows = []
    for clip in clips:
        times = ", ".join(f"{event['time'] / clip['seconds']:.5f}f" for event in clip["events"])
        what = ", ".join(json.dumps(event["event"]) for event in clip["events"])
        name, loops = json.dumps(clip["state"][:40].strip()), str(clip["loop"]).lower()
        rows.append(
            f"        new Known {{ name = {name}, loops = {loops}, times = new float[] "
            f"{{ {times} }}, what = new string[] {{ {what} }} }},"
        )
    return [
        _written(
            figure.parent / "Editor" / f"{figure.stem}Import.cs",
            _UNITY_SCRIPT,
            NAME=figure.stem,
            CLASS=re.sub(r"\W", "_", f"Import_{figure.stem}"),
            CLIPS="\n".join(rows),
            FILE=json.dumps(figure.name),
            ROOT=json.dumps(root or "-"),
        )
    ]


def _written(path: Path, template: str, **values: str) -> Path:
    """Writes a template with its capitals replaced."""
    text = re.sub(r"\$([A-Z]+)\b", lambda match: values[match[1]], template)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path
