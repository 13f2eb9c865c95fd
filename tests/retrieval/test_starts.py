"""Starting from clips: what the shipped models make of rare and frequent sentences; teaching."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from latentmotion import MotionPipeline
from latentmotion.cli.main import main
from latentmotion.errors import InputError, ModelError
from latentmotion.model.card import MOVES_FILE
from latentmotion.motion import Motion
from latentmotion.retrieval.doubts import DoubtWarning

RARE, FREQUENT = "a person does a cartwheel", "a person walks forward"


@pytest.fixture(scope="module")
def fast():
    return MotionPipeline.from_pretrained("fast", threads=1)


def upside_down(motion):
    """Whether the head is below the pelvis at some time."""
    return bool((motion.joints[:, 15, 1] < motion.joints[:, 0, 1]).any())


def test_a_rare_movement_starts_from_a_clip_and_a_frequent_one_does_not(fast):
    rare, frequent = fast.batch([RARE, FREQUENT], seeds=[0, 0])
    (clip,) = rare.metadata["from_clips"]
    assert "cartwheel" in clip["caption"] and clip["credit"] and clip["license"]
    assert rare.metadata["steps_left"] == 0.25 and upside_down(rare)
    assert "from_clips" not in frequent.metadata


def test_who_does_it_does_not_hide_what_is_done(fast):
    """From "a woman puts on a jacket" to the caption of a person the cosine is 0.58."""
    motions = fast.batch(["a woman puts on a jacket", "the man does a cartwheel"], seeds=[0, 0])
    clips = [motion.metadata["from_clips"][0]["caption"] for motion in motions]
    assert "jacket" in clips[0] and "cartwheel" in clips[1]


@pytest.mark.parametrize(
    ("sentence", "word"),
    [
        ("A tennis player tosses the ball up and serves.", "serve"),
        ("He puts on a jacket, right arm first.", "jacket"),
        ("basketball free throw", "free throw"),
    ],
)
def test_a_drawn_movement_is_started_from_where_its_words_are_said(fast, sentence, word):
    (choice,) = fast.clip_starts.chooser.choices(fast.read(sentence))
    assert word in captions_of_start(fast, choice)


def captions_of_start(fast, choice):
    """All captions of the clip that a movement starts from."""
    return "; ".join(fast.clip_starts.chooser.index.texts_of(choice.neighbors[0].caption.clip))


def test_other_words_are_no_start(fast):
    assert fast.clip_starts.chooser.choices(fast.read("pick something up while walking")) == []


@pytest.mark.parametrize(
    ("sentence", "says"),
    [
        ("both hands on hips, elbows out", "both hands on the hips"),
        ("cartwheel to the left", "cartwheel"),
        ("walks in place", "in place"),  # "walks like he owns the place"
        ("marching on the spot", "marches in place"),  # soldiers march on
        ("lean to the left as far as possible", "lean to the right"),  # mirrored
        ("kneels on both knees, hands folded", "both knees"),  # "kneeling on one knee"
        ("sneaking on tiptoes, really exaggerated, cartoon style", "sneaks on tiptoes"),
        ("rotate rightward", "rotates to the right"),  # "rotates the torso to the right"
    ],
)
def test_how_and_where_a_movement_is_done_does_not_hide_it(fast, sentence, says):
    choices = fast.clip_starts.chooser.choices(fast.read(sentence))
    assert says in captions_of_start(fast, choices[0])


def test_who_spins_does_not_spin_on_the_back(fast):
    [choice] = fast.clip_starts.chooser.choices(fast.read("spins"))
    assert not any("back" in neighbor.caption.text for neighbor in choice.neighbors)


@pytest.mark.parametrize(
    ("sentence", "says"),
    [
        ("bows to the queen", "bows"),  # "bow and arrow" is nearer
        ("get down on both knees", "down on both knees"),  # "both hands on the knees"
        ("plops down on a bench", "plops down"),  # "bench presses"
        ("swing a katana", "slashes with a sword"),  # "pulls out the katana"
        ("combs her hair in front of a mirror", "combs"),  # "shaves in front of a mirror"
    ],
)
def test_all_captions_of_a_drawn_clip_decide(fast, sentence, says):
    (choice,) = fast.clip_starts.chooser.choices(fast.read(sentence))
    assert says in captions_of_start(fast, choice)


@pytest.mark.parametrize(
    ("sentence", "says"),
    [
        ("a soldier loads a cannon", "soldier on patrol"),
    ],
)
def test_what_nothing_is_near_is_doubted_and_made_as_what_is_nearest(fast, sentence, says):
    reading = fast.read(sentence)
    assert reading.doubt and reading.caption == reading.doubt.nearest
    (choice,) = fast.clip_starts.chooser.choices(reading)
    assert says in reading.caption and says in choice.neighbors[0].caption.text


def test_a_counted_act_is_no_crowd(fast):
    assert fast.read("two jumping jacks").doubt is None
    assert fast.read("two guys jump").doubt and fast.read("two people clap twice").doubt


def test_a_doubt_names_what_is_made(fast):
    reading = fast.read("two dolphins leap out of the water")
    assert reading.doubt and reading.doubt.nearest == reading.caption


@pytest.mark.parametrize(
    ("sentence", "name"),
    [
        ("serena aces with a booming serve", "a person serves in tennis"),
        ("an olympian heaves the iron ball from the shoulder", "a person puts the shot"),
        ("the maestro leads the symphony", "a person conducts an orchestra"),
        ("tiptoe so nobody wakes up", "a person tiptoes"),  # certainly, though it claims a gait
        ("bring the left knee up to the waist", "a person raises the left knee"),
        ("walks to the window", None),  # claims a gait
        ("rubs the back of her neck and rolls her shoulders", None),  # two
    ],
)
def test_a_sentence_that_names_a_drawn_movement_is_read_as_it(fast, sentence, name):
    assert fast.read(sentence).caption == name


@pytest.mark.parametrize(
    ("sentence", "doubted"),
    [
        ("marches while saluting", None),  # layered
        ("turns around twice, staggers and sits down", None),
        ("does a cartwheel, then defragments the disk", "defragments the disk"),
    ],
)
def test_only_what_is_not_made_is_doubted(fast, sentence, doubted):
    doubt = fast.read(sentence).doubt
    assert (doubt and doubt.about) == doubted


def test_who_sits_does_not_sit_down_again(fast):
    (motion,) = fast.batch(["backs into a chair and sits"], seeds=[0])
    assert len(motion.metadata["from_clips"]) == 1


def test_who_jumps_onto_a_box_does_not_jump_off_one(fast):
    (onto,), (off,) = (
        fast.clip_starts.chooser.choices(fast.read(f"jumps {way} a box")) for way in ("onto", "off")
    )
    assert "off" in off.neighbors[0].caption.text and "off" not in onto.neighbors[0].caption.text


def test_who_puts_the_hands_up_does_not_put_a_hand_up(fast):
    (hands,), (hand,) = (
        fast.clip_starts.chooser.choices(fast.read(f"put your {limb} up"))
        for limb in ("hands", "hand")
    )
    assert hand.neighbors[0].caption.text == "put your hand up"
    assert "hands" in hands.neighbors[0].caption.text


def test_a_clip_is_slowed_down_for_who_is_slow(fast):
    usual, slow = fast.batch(["knocks on a door", "knocks slowly on a door"], seeds=[0, 0])
    same = [motion.metadata["from_clips"][0]["clip"] for motion in (usual, slow)]
    assert same[0] == same[1] and len(slow) > 1.2 * len(usual)


@pytest.mark.parametrize(("side", "mirrored"), [("left", True), ("right", False)])
def test_the_other_side_of_a_drawn_movement_is_its_mirror_image(fast, side, mirrored):
    """The nearest caption is of the right leg, whichever side the sentence names."""
    [choice] = fast.clip_starts.chooser.choices(fast.read(f"kick with the {side} leg"))
    assert "with the right leg" in choice.neighbors[0].caption.text
    assert choice.neighbors[0].mirrored is mirrored


@pytest.mark.parametrize(
    "sentence",
    ["kick with the left leg, then with the right leg", "wave with the right hand, then the left"],
)
def test_one_side_after_the_other_starts_from_a_clip_and_its_mirror_image(fast, sentence):
    first, second = fast.clip_starts.chooser.choices(fast.read(sentence))
    assert first.neighbors[0].mirrored is not second.neighbors[0].mirrored


@pytest.mark.parametrize(
    ("sentence", "says"),
    [
        ("get up from the ground and walk", "get up from the ground"),  # 43 clips, and one drawn
        ("leaps for joy and bows", "bows"),  # not like a nobleman
    ],
)
def test_each_of_a_row_starts_as_it_is(fast, sentence, says):
    choices = fast.clip_starts.chooser.choices(fast.read(sentence))
    assert says in [near.caption.text for choice in choices for near in choice.neighbors[:1]]


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_drawn_movement_is_on_the_side_that_is_named(fast, side):
    """Its nearest sentence names no side, another one does."""
    prompt = f"leaps sideways to the {side} and catches the ball"
    (motion,) = fast.batch([prompt], seeds=[0])
    assert motion.metadata["from_clips"][0]["source"] == "gestures"
    across = motion.joints[-1, 0, 0] - motion.joints[0, 0, 0]  # left is +x
    assert across > 0.3 if side == "left" else across < -0.3


@pytest.mark.parametrize("model", ["fast", "starter"])
def test_cartwheels_of_four_seeds_turn_upside_down(fast, model):
    pipeline = fast if model == "fast" else MotionPipeline.from_pretrained(model, threads=1)
    steps = None if model == "fast" else 8
    motions = pipeline.batch([RARE] * 4, seeds=range(4), steps=steps)
    assert sum(map(upside_down, motions)) >= 3
    assert len({motion.joints.tobytes() for motion in motions}) == 4


def test_a_motion_from_a_clip_is_the_same_alone_and_among_others(fast):
    together = fast.batch([FREQUENT, RARE, RARE], seconds=3, seeds=[1, 2, 3])
    (alone,) = fast.batch([RARE], seconds=3, seeds=[2])
    np.testing.assert_allclose(together[1].joints, alone.joints, atol=1e-5)
    assert len(alone) == 60


def test_without_clips_motions_are_those_of_pure_noise(fast):
    (noise,) = fast.batch([RARE], seconds=3, seeds=[2], from_clips=False)
    assert "from_clips" not in noise.metadata
    features = fast.features([fast.read(RARE).prompt], [60], [2])
    np.testing.assert_allclose(noise.joints, fast.representation.decode(features[0]), atol=1e-5)


def test_a_named_side_takes_the_mirror_image_of_the_clip(fast):
    sides = [
        fast.clip_starts.chooser.neighbors(f"a man limps, his {side} leg is hurt", 1)[0]
        for side in ("left", "right")
    ]
    assert sides[0].caption == sides[1].caption and sides[0].mirrored != sides[1].mirrored
    motions = fast.batch([f"a man limps, his {side} leg is hurt" for side in ("left", "right")], 4)
    assert [m.metadata["from_clips"][0]["mirrored"] for m in motions].count(True) == 1


@pytest.mark.parametrize("joint", [", then ", " and ", ", "])
def test_movements_in_a_row_start_from_a_clip_each(fast, joint):
    (motion,) = fast.batch(f"a person drinks from a cup{joint}does a cartwheel", seeds=[0])
    assert len(motion.metadata["from_clips"]) == 2


@pytest.mark.parametrize(
    ("sentence", "captions"),
    [
        ("do three push-ups and stand up", ["push-ups", "stand up"]),
        ("ducks under a punch and answers with an uppercut", ["answers with an uppercut"]),
        ("dribbles, stops, shoots", ["dribbl", None, "hoop"]),  # not a gun
        (
            "tosses the ball up and serves",
            ["tosses the ball and serves"],
        ),  # a caption tells of both
        ("walks forward, then turns around and walks back", ["turns around and walks back"]),
        ("nearly falls, catches himself", ["catches himself"]),
        ("a guard marches and salutes", ["marches", "salute"]),  # not a hand that stops someone
        ("slips on a banana peel and falls", ["slips on a banana peel"]),
        ("he walks after waving", ["waves", None]),  # not at once
        ("before sitting down he waves", ["waves", "sits down"]),
        ("raises the left arm, then the right arm", ["raises the", "raises the"]),
        ("first the right arm goes up, then the left arm", ["right arm goes up"] * 2),
        ("two jabs and a cross, then bows", ["jabs followed by a cross", "bows"]),
        ("opens the door, bends to look inside, and closes it again", ["door", "bends"]),
    ],
)
def test_clauses_start_from_clips_of_their_own_unless_one_tells_of_all(fast, sentence, captions):
    choices = fast.clip_starts.chooser.choices(fast.read(sentence))
    assert len(choices) == len(captions)
    for choice, caption in zip(choices, captions, strict=True):
        texts = [neighbor.caption.text for neighbor in choice.neighbors]
        assert not texts if caption is None else caption in texts[0]


def test_who_does_push_ups_and_stands_up_rises_without_a_jump(fast):
    (motion,) = fast.batch(["do three push-ups and stand up"], seeds=[0])
    height = motion.joints[:, 0, 1]
    assert height[: len(height) // 3].max() < 0.5 and height[-10:].min() > 0.8
    assert np.abs(np.diff(height)).max() * motion.fps < 1.5  # m/s


@pytest.mark.parametrize("seconds", [1.0, 2.6, 9.8])
def test_movements_in_a_row_fit_in_a_given_length(fast, seconds):
    prompt = "drinks from a cup, does push-ups, then gets up and salutes"
    (motion,) = fast.batch([prompt], seconds, [0])
    assert len(motion) == round(seconds * motion.fps) and np.isfinite(motion.joints).all()
    assert len(motion.metadata["from_clips"]) >= 2


def test_who_climbed_stays_up_for_what_follows(fast):
    (motion,) = fast.batch(["climbs a ladder and waves"], seeds=[0])
    lowest = motion.joints[..., 1].min(axis=1)
    assert len(motion.metadata["from_clips"]) == 2 and lowest[-20:].min() > 0.5 > lowest[:10].max()


def test_a_gesture_is_made_over_a_gait(fast):
    motion = fast("a man walks while drinking coffee", seed=3, seconds=5)
    at = {name: n for n, name in enumerate(motion.skeleton.names)}
    joints = motion.joints
    near = np.linalg.norm(joints[:, at["right_wrist"]] - joints[:, at["head"]], axis=-1) < 0.35
    assert "coffee" in motion.metadata["from_clips"][0]["caption"]
    assert near.mean() > 0.2  # the cup is at the mouth
    assert np.linalg.norm(joints[-1, 0, [0, 2]] - joints[0, 0, [0, 2]]) > 2


def test_a_clip_beneath_a_gesture_is_credited_too(fast):
    motion = fast("runs with both arms in the air", seed=3)
    clips = [clip["caption"] for clip in motion.metadata["from_clips"]]
    assert any("arms" in clip for clip in clips) and any("run" in clip for clip in clips)


def test_who_sits_stays_on_the_seat_for_a_gesture(fast):
    motion = fast("sits and waves", seed=3)
    at = {name: n for n, name in enumerate(motion.skeleton.names)}
    waves = motion.joints[:, at["right_wrist"], 1] > motion.joints[:, at["right_shoulder"], 1]
    assert waves.any() and motion.joints[waves, 0, 1].max() < 0.75


@pytest.mark.parametrize(
    "sentence",
    ["walking and waving", "walks while looking at a phone", "walking, chin up", "climbing a rock"],
)
def test_what_a_caption_tells_or_no_drawn_gesture_shows_is_not_layered(fast, sentence):
    assert not any(choice.under for choice in fast.clip_starts.chooser.choices(fast.read(sentence)))


def test_who_walks_before_a_rare_movement_goes_some_way(fast):
    walk, stand = fast.batch(["a person walks, then salutes", "salute"], seeds=[0, 0])
    for motion in (walk, stand):
        (clip,) = motion.metadata["from_clips"]
        assert "salute" in clip["caption"]
    gone = [np.linalg.norm(m.joints[-1, 0] - m.joints[0, 0]) for m in (walk, stand)]
    assert gone[0] > 1.0 > gone[1] and len(walk) > len(stand)


def test_a_recording_starts_after_its_calibration(fast):
    motion = fast.batch("a person walks to a chair and sits down", seeds=[0])[0]
    across = motion.joints[0, 20] - motion.joints[0, 21]  # between the wrists
    assert np.linalg.norm(across[[0, 2]]) < 0.9


def test_a_clip_is_no_longer_than_its_act_usually_is(fast):
    long, given = fast.batch(["a person drinks"] * 2, [None, 7.0], [0, 0])
    assert (len(long), len(given)) == (80, 140)
    assert len(fast("a person raises both hands", seed=60)) <= 80  # rest makes it no longer


def test_an_act_that_may_last_any_time_takes_the_length_of_its_clip(fast):
    assert fast("runs while holding the hat on his head", seed=0).seconds <= 9.8


def test_half_of_the_takes_start_from_clips_and_have_an_advantage(fast):
    motion = fast("she sweeps the floor", seed=0)
    advantages = [take["advantage"] for take in motion.metadata["best_of"]]
    assert sum(one > 0 for one in advantages) == 2 and motion.metadata["from_clips"]
    plain = fast("she sweeps the floor", seed=0, from_clips=False)
    assert not any(take["advantage"] for take in plain.metadata["best_of"])


def test_values_of_from_clips_are_counted(fast):
    with pytest.raises(InputError, match="1 values of from_clips for 2"):
        fast.batch([RARE, RARE], from_clips=[True])


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.UnknownWordsWarning")
@pytest.mark.parametrize(
    ("sentence", "about"),
    [
        ("a person plays the didgeridoo", "didgeridoo"),
        ("a dog runs", "dog"),
        ("wiggle your fingers", "fingers"),
        ("the economy is growing", "the economy is growing"),
        ("three apples", "three apples"),
        ("a giraffe nibbles leaves", "a giraffe nibbles leaves"),
        ("a person walks forward, then plays chess", "chess"),
    ],
)
def test_what_is_not_known_is_said(fast, sentence, about):
    with pytest.warns(DoubtWarning, match="nearest that I learned"):
        motion = fast(sentence, seconds=2, takes=1)
    note = motion.metadata["notes"][0]
    assert f'not sure about "{about}"' in note


@pytest.mark.parametrize(
    "sentence",
    [FREQUENT, RARE, "someone walks like a dog", "kick twice with the left leg", "claps twice"],
)
def test_nothing_is_said_of_what_is_known(fast, sentence):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert "notes" not in fast.batch([sentence], seconds=2)[0].metadata


@pytest.mark.filterwarnings("ignore::latentmotion.retrieval.doubts.DoubtWarning")
@pytest.mark.parametrize(
    ("prompt", "word"),
    [
        ("ape around", "monkey"),
        ("mix the salad", "mixing"),
        ("tripping while walking", "stumbles"),  # a wording as it stands, whatever it claims
    ],
)
def test_an_activity_is_read_in_words_of_captions(fast, prompt, word):
    reading = fast.read(prompt)
    assert reading.sentence == prompt and word in reading.prompt
    motion = fast(prompt, seconds=2)
    assert motion.caption == prompt and motion.metadata["read_as"] == reading.prompt
    assert motion.metadata["from_clips"]
    assert f'read as "{reading.prompt}"' in motion.metadata["notes"]


@pytest.mark.parametrize(
    "sentence", ["a person walks forward", "hop three times", "he raises the left arm"]
)
def test_what_captions_say_themselves_is_read_as_it_stands(fast, sentence):
    assert fast.read(sentence).caption is None


def test_prepared_data_is_taught_with_wordings(fast, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recorded = fast("a person squats down", seconds=3, seed=1, takes=1)
    Path("clips").mkdir()
    recorded.save("clips/frog.npz")
    Path("clips/frog.txt").write_text("a person does the frog\n")
    main(
        [
            "data",
            "prepare",
            "own",
            "clips",
            "-o",
            "data",
            "--generated",
            "--val",
            "0",
            "--test",
            "0",
        ]
    )
    Path("words.tsv").write_text("a person does the frog\tlives by the pond\n")
    main(["teach", "data", "--wordings", "words.tsv", "-o", "moves"])
    assert "1 clips" in capsys.readouterr().out
    taught = fast.with_moves("moves")
    assert taught.read("lives by the pond").prompt == "a person does the frog"
    Path("others.tsv").write_text("someone drives a car\tmotoring\n")
    for wrong, said in (
        (["data", "a frog"], "SENTENCES has no effect"),
        (["data", "--between", "0", "1"], "--between has no effect"),
        (["data", "--wordings", "others.tsv"], "none of 1 captions with wordings"),
        (["clips/frog.npz", "a frog", "--wordings", "words.tsv"], "--wordings has no effect"),
        (["clips/frog.npz", "a frog", "--compact"], "--compact has no effect"),
    ):
        with pytest.raises(SystemExit):
            main(["teach", *wrong, "-o", "other"])
        assert said in capsys.readouterr().err and not Path("other").exists()


def test_a_word_is_not_read_as_one_with_another_first_letter(fast):
    assert fast.read("my uncle sows the field").corrections == ()
    assert fast.read("he lops the hedge").corrections == ()  # hops


def test_misspelled_words_are_corrected_and_said(fast):
    with pytest.warns(DoubtWarning, match='read "wlaks" as "walks"'):
        motion = fast("a person wlaks forward", seconds=2, seed=3, takes=1)
    assert motion.caption == "a person wlaks forward"
    right = fast("a person walks forward", seconds=2, seed=3, takes=1)
    np.testing.assert_array_equal(motion.joints, right.joints)


def test_a_movement_is_taught_by_showing(fast, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fast("a person squats down", seconds=3, seed=1, takes=1).save("shown.npz")
    sentence = "a person does the frog"
    main(["teach", "shown.npz", sentence, "--license", "CC0", "--credit", "me", "-o", "moves"])
    main(["teach", "shown.npz", "someone sits like a frog", "--between", "0.5", "2", "-o", "moves"])
    assert "2 clips, 2 sentences" in capsys.readouterr().out
    main(["generate", sentence, "--moves", "moves", "-o", "frog.npz", "--no-clean"])
    (clip,) = Motion.load("frog.npz").metadata["from_clips"]
    assert clip["caption"] == sentence and clip["license"] == "CC0" and clip["credit"] == "me"
    taught = fast.with_moves("moves")
    shown = Motion.load("shown.npz").joints
    lowest = [m.joints[:, 0, 1].min() for m in taught.batch([sentence] * 3, seeds=range(3))]
    assert max(abs(np.array(lowest) - shown[:, 0, 1].min())) < 0.12
    # Other sentences start as they did before.
    again, before = (each.batch([RARE], 2, [1])[0].joints for each in (taught, fast))
    np.testing.assert_allclose(again, before, atol=2e-2)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["teach", "shown.npz"], "sentence"),
        (["teach", "none.npz", "a wave"], "none.npz"),
        (["teach", "shown.npz", "a wave", "--between", "2", "9"], "the clip lasts"),
        (["generate", "a wave", "--moves", "nowhere", "-o", "x.npz"], "latentmotion teach"),
    ],
)
def test_wrong_input_ends_in_one_line(fast, tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    fast(FREQUENT, seconds=2).save("shown.npz")
    with pytest.raises(SystemExit) as exit:
        main(arguments)
    assert exit.value.code == 2 and said in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["shown.npz"]


def test_clips_of_another_model_are_refused(fast, tmp_path):
    index = replace(fast.clip_starts.chooser.index, latent_space="another")
    index.write(tmp_path / MOVES_FILE)
    with pytest.raises(ModelError, match="another model"):
        fast.with_moves(tmp_path)


def taught(fast, sentence):
    """The pipeline that was shown a clip for a sentence."""
    from latentmotion.data.clip import Caption, Source
    from latentmotion.retrieval.teach import ShownClip, build_index

    features = fast.representation.encode(fast(FREQUENT, seconds=3, takes=1).joints)
    clip = ShownClip("mine", "me", "mine", features, (Caption(sentence, 0, len(features)),))
    encoders = fast.feature_encoder, fast.text_encoder
    index = build_index([clip], [Source("me", "CC0", "me")], fast.card, *encoders)
    return fast.with_moves(index.preferred())


@pytest.mark.parametrize(
    "sentence",
    [
        "a person is painting a wall",  # drawn, too
        "a person raises the right hand, then brings the hands together and takes a bow",
        "a ballerina is bringing the leg forward then taking a bow",
    ],
)
def test_what_a_user_showed_is_started_from_alone(fast, sentence):
    pipeline = taught(fast, sentence)
    prompt = f"she {sentence.split(' ', 2)[2]}"
    for motion in pipeline.batch([prompt] * 3, seeds=range(3)):
        assert [clip["source"] for clip in motion.metadata["from_clips"]] == ["me"]


def test_what_a_user_showed_has_no_gesture_over_it(fast):
    pipeline = taught(fast, "a person strolls along eating apples")
    (motion,) = pipeline.batch(["walks while eating an apple"], seeds=[0])
    assert [clip["source"] for clip in motion.metadata["from_clips"]] == ["me"]


@pytest.mark.filterwarnings("ignore::latentmotion.engine.encoder.UnknownWordsWarning")
def test_a_sentence_near_a_taught_clip_is_read_as_it_stands(fast):
    pipeline = taught(fast, "i ape around")
    assert fast.read("ape around").caption and pipeline.read("ape around").caption is None


@pytest.mark.parametrize("idle", ["someone", "person, then walk forward"])
def test_a_subject_alone_is_no_movement(fast, idle):
    assert fast.read(idle).caption is None


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_movement_that_both_sides_show_starts_from_no_mirror_image(fast, side):
    motions = fast.batch([f"cartwheel to the {side}"] * 2, seeds=[0, 1])
    for motion in motions:
        (clip,) = motion.metadata["from_clips"]
        assert side in clip["caption"] and not clip["mirrored"]


@pytest.mark.parametrize(
    ("sentence", "says"),
    [
        ("gets slapped in the face", "gets hit in the face"),  # "slaps somebody in the face"
        ("is kicked in the shin", "is kicked in the gut"),
        ("is hit by a ball", "is knocked back"),  # "hits the ball with a bat"
        ("somebody shoves her", "is shoved"),  # "shoves another person"
        ("a man is pushed to the ground", "gets pushed"),
        ("is shot by an arrow", "hit by an arrow"),  # "shoots an arrow"
        ("pushes", "pushes"),  # "gets pushed" is nearer
        ("kicked the ball", "kicks a soccer ball"),
        ("is thrown over the shoulder", None),  # "throws somebody over the shoulder"
    ],
)
def test_who_is_acted_upon_reacts(fast, sentence, says):
    choices = fast.clip_starts.chooser.choices(fast.read(sentence))
    texts = [captions_of_start(fast, choice) for choice in choices if choice.neighbors]
    assert not texts if says is None else says in texts[0]
