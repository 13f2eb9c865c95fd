extends CharacterBody3D
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
