"""A motion in a notebook: a picture, and the viewer in its place where scripts run.

The first motion that a process shows carries the viewer (some 300 kB), later ones use it. Where no
script runs, as on GitHub, the picture stays.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from latentmotion.errors import MissingExtraError
from latentmotion.motion import Motion
from latentmotion.viewer.page import filled_page, json_in_html, marks_of, payload

# Figures of the picture, and its pixels from left to right.
_FIGURES, _WIDTH = 6, 640

_HTML = Path(__file__).with_name("notebook.html").read_text(encoding="utf-8")

_is_shown = False


def bundle(motion: Motion) -> dict[str, str]:
    """Returns a motion by media type."""
    global _is_shown
    motions = payload([motion])
    motions["motions"][0]["marks"] = marks_of(motion)
    content = json_in_html(motions)
    page = filled_page("Latent Motion", "{{motions}}")
    viewer = "" if _is_shown else f"globalThis.latentmotionViewer = {_in_script(page)};"
    _is_shown = True
    picture, caption = "", html.escape(motion.caption or "a motion")
    with suppress(MissingExtraError), TemporaryDirectory() as folder:  # no picture without Pillow
        from latentmotion.render import strip

        path = Path(folder) / "strip.png"
        strip.write(path, [motion], figures=_FIGURES, width=_WIDTH)
        picture = base64.b64encode(path.read_bytes()).decode("ascii")
    shown = f'<img src="data:image/png;base64,{picture}" alt="{caption}">' if picture else caption
    name = hashlib.sha256(content.encode()).hexdigest()[:16]
    text = _HTML.format(name=name, picture=shown, viewer=viewer, content=_in_script(content))
    pictures = {"image/png": picture} if picture else {}
    return {"text/plain": repr(motion), "text/html": text, **pictures}


def _in_script(text: str) -> str:
    """Returns a text as a string of JavaScript that ends no script element."""
    return json.dumps(text).replace("<", "\\u003c")
