"""Prompts in other languages: what is understood of them, and that English is left alone."""

from __future__ import annotations

import warnings

import pytest

from latentmotion import MotionPipeline
from latentmotion.data.instructions import instructions
from latentmotion.language.translation import in_english
from latentmotion.measure.scene import describe

LANGUAGES = {
    "fr": {
        "une personne marche en arrière": "walks backwards",
        "la personne monte les escaliers": "walks up the stairs",
        "quelqu'un saute deux fois, puis s'assied": "jumps twice, then sits down",
        "Un homme donne un coup de pied avec la jambe droite.": "kicks with the right leg",
    },
    "de": {
        "eine Person geht rückwärts": "walks backwards",
        "eine Person geht die Treppe hinunter": "walks down the stairs",
        "jemand geht seitwärts nach links": "walks sideways to the left",
        "sie hebt etwas vom Boden auf": "picks something up",
        "jemand dreht sich nach rechts und winkt": "turns to the right, then waves",
    },
    "es": {
        "una persona camina hacia atrás": "walks backwards",
        "una persona levanta ambas manos": "raises both hands",
    },
    "it": {
        "una persona cammina lentamente all'indietro": "walks backwards slowly",
        "una persona si siede e poi si alza": "sits down, then stands up",
    },
    "pt": {
        "uma pessoa anda para trás": "walks backwards",
        "uma pessoa levanta o braço direito": "raises the right arm",
    },
    "nl": {
        "een persoon loopt achteruit": "walks backwards",
        "een man hurkt en staat weer op": "squats, then stands up",
        "een persoon gaat zitten en staat op": "sits down, then stands up",
    },
    "ru": {
        "человек идёт назад": "walks backwards",
        "человек поднимает правую руку": "raises the right hand",
    },
    "zh": {
        "一个人向后走": "walks backwards",
        "有人跳两次，然后坐下": "jumps twice, then sits down",
    },
    "ja": {
        "人が後ろに歩く": "walks backwards",
        "人がゆっくり歩いて座る": "walks slowly, then sits down",
    },
    "ko": {
        "사람이 뒤로 걷는다": "walks backwards",
        "여자가 원을 그리며 달린다": "runs in a circle",
        "누군가 두 번 점프한다": "jumps twice",
    },
}


@pytest.mark.parametrize("language", LANGUAGES)
def test_short_prompts_are_understood(language: str) -> None:
    for sentence, english in LANGUAGES[language].items():
        found = in_english(sentence)
        assert found is not None, sentence
        assert (found.english, found.language, found.left) == (f"a person {english}", language, ())


def test_english_and_unknown_languages_are_left_alone() -> None:
    for instruction in instructions():
        assert in_english(instruction.prompt) is None
    for sentence in ("archery", "a backflip", "someone plays the violin", "", "人", "12 '-' ,"):
        assert in_english(sentence) is None


def test_what_is_not_understood_is_said() -> None:
    found = in_english("une personne marche vers le château")
    assert found is not None and "château" in found.left
    assert str(found) == 'understood: "a person walks"; not understood: château'


def test_a_prompt_in_french_becomes_its_motion_and_a_note() -> None:
    pipeline = MotionPipeline.from_pretrained(threads=1)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = pipeline("une personne marche en arrière", seconds=4, seed=1)
    assert any('understood: "a person walks backwards"' in str(one.message) for one in said)
    assert motion.caption == "une personne marche en arrière"
    assert 'understood: "a person walks backwards"' in motion.metadata["notes"]
    # The studio shows it while it is typed.
    reading = pipeline.read(motion.caption)
    assert 'understood: "a person walks backwards"' in reading.notes()
    assert describe(motion.joints).path.forward < -0.5
    english = pipeline("a person walks backwards", seconds=4, seed=1)
    assert (motion.joints == english.joints).all()
