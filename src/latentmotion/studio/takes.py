"""Routes of takes: made, listed, changed, shown, written to files with their edits."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import Response
from pydantic import Field

from latentmotion.data.clip import Caption, Source
from latentmotion.errors import InputError
from latentmotion.formats import MEDIA_TYPES, npz
from latentmotion.formats.content import encoded
from latentmotion.kinematics.skeleton import HUMANML3D
from latentmotion.model.card import MOVES_FILE
from latentmotion.motion import features_of
from latentmotion.pipeline import MotionPipeline, RawMotion
from latentmotion.ranking import best as ranking
from latentmotion.retrieval.index import joined
from latentmotion.retrieval.teach import ShownClip, build_index
from latentmotion.service.schemas import FileFormat, Readable, RequestModel, Text
from latentmotion.service.state import Service, unless_gone
from latentmotion.service.uploads import BINARY_BODY, Fps, file_response, uploaded
from latentmotion.studio import schemas
from latentmotion.studio.library import MOST_LISTED, Edits, Library, StoredTake
from latentmotion.studio.models import Models

MOST_IMPORTED = 100  # Most motions of a file that is imported.

_EDITS = ("trim", "speed", "in_place", "mirrored")


def recipe_routes(service: Service, library: Library, models: Models) -> APIRouter:
    """Returns the routes of takes made from their recipe."""
    router = APIRouter()

    @router.post("/takes")
    async def make(request: Request, body: schemas.TakesRequest) -> dict[str, Any]:
        """Make takes of a recipe and keep them."""
        service.check_ready()
        maker = await run_in_threadpool(models.maker, body.model)
        work = partial(maker.made, body.recipe, body.takes)
        motions = await unless_gone(request, service.called(work, service.settings.deadline))
        takes = await run_in_threadpool(library.add, motions)
        notice = _notice(motions[0][0].metadata)
        return {"takes": [take.about() | notice for take in takes]}

    @router.get("/reading")
    def reading(
        prompt: Annotated[str, Query(max_length=500)], model: Annotated[str, Query()] = ""
    ) -> dict[str, Any]:
        """Say what a model does not know of a prompt, while it is typed."""
        service.check_ready()
        return _notice(models.maker(model or None).pipeline.read(prompt).about())

    @router.post("/takes/{name}/again")
    async def again(request: Request, name: schemas.Id) -> dict[str, Any]:
        """Make a take again from its recipe, and compare; a missing file is written again."""
        service.check_ready()
        take = await run_in_threadpool(library.take, name)
        maker = await run_in_threadpool(models.maker_again, take.recipe)
        work = partial(maker.again, take.recipe)
        motion = await unless_gone(request, service.called(work, service.settings.deadline))
        equal, back = await run_in_threadpool(library.compare, take, motion)
        return {"equal": equal, "restored": back}

    return router


def _notice(about: Mapping[str, Any]) -> dict[str, Any]:
    return {"notice": "; ".join(about.get("notes", ())), "nearest": about.get("nearest", [])}


def routes(library: Library) -> APIRouter:
    """Returns the routes of takes in the library: listed, changed, deleted."""
    router = APIRouter()

    @router.get("/takes")
    def listed(
        query: Annotated[str, Query(max_length=500)] = "",
        tag: Annotated[str, Query(max_length=50)] = "",
        star: bool | None = None,
        deleted: bool = False,
        offset: Annotated[int, Query(ge=0, lt=2**53)] = 0,
        limit: Annotated[int, Query(ge=1, le=MOST_LISTED)] = 100,
    ) -> dict[str, Any]:
        """List takes, the newest first."""
        total, takes = library.takes(query, tag, star, deleted, offset, limit)
        return {"total": total, "takes": [take.about() for take in takes], "tags": library.tags()}

    @router.get("/takes/{name}")
    def shown(name: schemas.Id) -> dict[str, Any]:
        """Describe a take."""
        return library.take(name).about()

    @router.patch("/takes/{name}")
    def changed(name: schemas.Id, body: schemas.TakeChanges) -> dict[str, Any]:
        """Change title, tags, star or edits of a take."""
        take, changes = library.take(name), body.model_dump(include=body.model_fields_set)
        edits = {key: changes.pop(key) for key in _EDITS if key in changes}
        if "tags" in changes:
            changes["tags"] = tuple(changes["tags"])
        return library.change(name, edits=replace(take.edits, **edits), **changes).about()

    @router.delete("/takes/{name}")
    def deleted(name: schemas.Id) -> dict[str, Any]:
        """Mark a take as deleted; `restore` takes the mark away."""
        return library.change(name, deleted=True).about()

    @router.post("/takes/{name}/restore")
    def restored(name: schemas.Id) -> dict[str, Any]:
        """Take the mark of a deleted take away."""
        return library.change(name, deleted=False).about()

    @router.post("/takes/{name}/duplicate")
    def duplicated(name: schemas.Id) -> dict[str, Any]:
        """Keep the motion of a take as another one, to be edited apart."""
        return library.duplicate(name).about()

    return router


def file_routes(service: Service, library: Library) -> APIRouter:
    """Returns the routes of one take as a file."""
    router = APIRouter()

    @router.get("/takes/{name}/joints", response_class=Response)
    def joints(name: schemas.Id) -> Response:
        """Send the joints of a take as float32, little-endian: frames × joints × 3, meters."""
        return several([name])

    @router.get("/joints", response_class=Response)
    def several(
        take: Annotated[list[schemas.Id], Query(min_length=1, max_length=schemas.MOST_TAKES)],
    ) -> Response:
        """Send the joints of several takes one behind the other, X-Frames and X-Fps of each."""
        motions = [library.motion(library.take(name)) for name in take]
        headers = {
            "X-Frames": ",".join(str(len(motion)) for motion in motions),
            "X-Fps": ",".join(f"{motion.fps:.17g}" for motion in motions),
        }
        content = b"".join(motion.joints.astype("<f4").tobytes() for motion in motions)
        return Response(content, headers=headers, media_type="application/octet-stream")

    @router.get("/takes/{name}/viewer", response_class=Response)
    async def viewer(name: schemas.Id) -> Response:
        """Send what the viewer reads."""
        return await sent(name, Written("viewer"))

    @router.get("/takes/{name}/file", response_class=Response)
    async def file(
        name: schemas.Id,
        form: Annotated[FileFormat, Query(alias="format")] = "glb",
        fps: Fps = None,
        character: schemas.Id | None = None,
    ) -> Response:
        """Send a take as a file, edited as it is shown, on a character if one is named."""
        return await sent(name, Written(form, fps, character))

    @router.get("/takes/{name}/on/{character}.glb", response_class=Response)
    async def on_character(name: schemas.Id, character: schemas.Id, fps: Fps = None) -> Response:
        """Send a take on a character; one of bones alone is given a mannequin's surface."""
        return await sent(name, Written("glb", fps, character))

    async def sent(name: str, form: Written) -> Response:
        take = await run_in_threadpool(library.take, name)
        content, ending = await content_of(service, library, take, form)
        headers = {"Content-Disposition": f'attachment; filename="{file_name(take, ending)}"'}
        return Response(content, headers=headers, media_type=MEDIA_TYPES[ending])

    return router


def transfer_routes(service: Service, library: Library) -> APIRouter:
    """Returns the routes that send takes as an archive, and take motions of files in."""
    router = APIRouter()

    @router.post("/export", response_class=Response)
    async def exported(request: Request, body: schemas.ExportRequest) -> Response:
        """Send several takes as a zip archive of files."""
        takes = [await run_in_threadpool(library.take, name) for name in body.ids]
        form = Written(body.format, body.fps, body.character)
        with tempfile.TemporaryDirectory(prefix="latentmotion-") as folder:
            path = Path(folder) / "takes.zip"
            await unless_gone(request, archived(service, library, takes, form, path))
            return file_response(path, path.name)

    def stored(name: str, file: Path) -> list[StoredTake]:
        """Keeps the motions of an imported file."""
        motions = npz.read_motions(file)
        if len(motions) > MOST_IMPORTED:
            count = f"{name!r} has {len(motions)} motions"
            raise InputError(f"{count}, expected at most {MOST_IMPORTED}")
        names = motions[0].skeleton.names
        if names != HUMANML3D.names:
            raise InputError(
                f"{name!r} has {len(names)} joints of skeleton {motions[0].skeleton.name!r}; "
                f"expected the {len(HUMANML3D)} of {HUMANML3D.name}, or a skeleton whose names are "
                "known"
            )
        return library.add(
            (motion.cut(), {"imported": name}, motion.caption or Path(name).stem, Edits())
            for motion in motions
        )

    @router.post("/import", openapi_extra=BINARY_BODY)
    async def imported(request: Request, name: schemas.FileName) -> dict[str, Any]:
        """Keep the motions of a file, each as a take."""
        ending = Path(name).suffix.lower().lstrip(".")
        if ending not in get_args(Readable):
            readable = ", ".join(get_args(Readable))
            raise InputError(f"{name!r} is no motion that can be read; expected {readable}")
        async with uploaded(service, request, f"motion.{ending}") as folder:
            task = {"verb": "convert", "file": f"motion.{ending}", "format": "npz", "clean": None}
            task |= {"folder": str(folder), "fps": None}
            await unless_gone(request, service.read(task))
            takes = await run_in_threadpool(stored, name, folder / "answer")
        return {"takes": [take.about() for take in takes]}

    return router


@dataclass(frozen=True)
class Written:
    """How takes are written."""

    format: str  # Format of the service.
    fps: float | None = None  # Frames per second; by default the take's own.
    character: str | None = None  # Name of the character; by default the mannequin of the format.


async def content_of(
    service: Service, library: Library, take: StoredTake, form: Written
) -> tuple[bytes, str]:
    """Returns a take as a file's content, and the file's ending.

    Raises:
        LatentMotionError: The motion or the character cannot be used, or not written so.
        Problem: Too much waits, or it took too long.
    """
    if form.character is not None and form.format not in schemas.CHARACTER_FORMATS:
        formats = " or ".join(schemas.CHARACTER_FORMATS)
        raise InputError(f"format {form.format}: characters are written as {formats}")
    motion = await run_in_threadpool(library.motion, take)
    if form.character is None:
        raw = [RawMotion(motion)]
        return await service.file(raw, form.format, False, form.fps, service.deadline())
    character = await run_in_threadpool(library.character, form.character)
    task = {
        **{"verb": "retarget", "map": character.joint_map(), "figure": True},
        **{"file": str(library.character_file(character).resolve()), "format": form.format},
    }
    with tempfile.TemporaryDirectory(prefix="latentmotion-") as folder:
        motion_file, _ = await run_in_threadpool(encoded, [motion], "npz")
        (Path(folder) / "motion.npz").write_bytes(motion_file)
        head = await service.read({**task, "folder": folder, "fps": form.fps})
        return (Path(folder) / "answer").read_bytes(), head["format"]


async def archived(
    service: Service, library: Library, takes: list[StoredTake], form: Written, path: Path
) -> None:
    """Writes takes as a zip archive of a file each.

    Raises:
        LatentMotionError: As `content_of`.
        Problem: Likewise.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for take in takes:
            content, ending = await content_of(service, library, take, form)
            await run_in_threadpool(archive.writestr, file_name(take, ending), content)


def file_name(take: StoredTake, ending: str) -> str:
    """Returns the name of a take's file: words of its title, and its number."""
    words = re.sub("[^a-z0-9]+", "-", take.title.lower())[:60].strip("-")
    return f"{words or 'take'}-{take.id[-6:].lower()}.{ending}"


# Difference of similarity, or meters per second that feet slide, that is worth a word.
_CLEAR = 0.02


class TeachRequest(RequestModel):
    """Sentences that a take shows."""

    sentences: Annotated[list[Text], Field(min_length=1, max_length=20)]
    """What the person in it does, in one or several wordings."""
    model: str | None = None
    """Name of the model that learns it; by default that of the studio's start."""


def model_routes(library: Library, models: Models) -> APIRouter:
    """Returns the routes by which a model compares takes, and learns one."""
    router = APIRouter()

    @router.get("/best")
    def best(
        take: Annotated[list[schemas.Id], Query(min_length=1, max_length=schemas.MOST_TAKES)],
    ) -> dict[str, Any]:
        """Score takes of one prompt as `best of` does, and say which is best and why.

        `take` is null where they cannot be scored; the higher a score, the better.
        """
        takes = [library.take(name) for name in dict.fromkeys(take)]
        prompts = {item.recipe.get("prompt") or "" for item in takes}
        unknown = {"take": None, "reason": "", "scores": {}}
        if len(prompts) > 1 or not min(prompts).strip():
            return unknown
        pipeline = models.service.pipeline
        scorer = ranking.scorer_beside(pipeline.condition)
        motions = [library.motion(item) for item in takes]
        try:
            ranked = ranking.ranked(motions, pipeline.read(min(prompts)).prompt, scorer)
        except InputError:  # motions that the scorer does not read
            return unknown
        names = {id(motion): item.id for motion, item in zip(motions, takes, strict=True)}
        scores = {names[id(item.motion)]: round(item.score, 4) for item in ranked}
        return {"take": next(iter(scores)), "reason": reason(ranked), "scores": scores}

    @router.post("/takes/{name}/teach")
    def taught(name: schemas.Id, body: TeachRequest) -> dict[str, int]:
        """Let takes of these sentences, and of near ones, start from a take."""
        take, model = library.take(name), models.named(body.model)
        clips, sentences = teach(models.opened(model), library, take, body.sentences)
        models.forget()
        return {"clips": clips, "sentences": sentences}

    return router


def reason(ranked: Sequence[ranking.Take]) -> str:
    """Returns in words what the first of ranked takes does better than the others do."""
    first, others = ranked[0], ranked[1:]
    if not others:
        return "the only one"
    count = len(others)
    mean = {
        name: sum(getattr(take, name) for take in others) / count for name in ("text", "sliding")
    }
    words = []
    if first.claims > max(take.claims for take in others):
        words.append("counts and turns as the prompt says")
    if first.text > mean["text"] + _CLEAR:
        words.append("closest to the prompt")
    if first.sliding < mean["sliding"] - _CLEAR:
        words.append("feet slide less")
    return ", ".join(words) or "all are close"


def teach(
    pipeline: MotionPipeline, library: Library, take: StoredTake, sentences: list[str]
) -> tuple[int, int]:
    """Adds a take to the clips of a library; returns how many clips and sentences these are.

    Raises:
        InputError: There is no sentence, the take is too short, or the model cannot be taught.
        ModelError: The library's clips are damaged, or were taught to another model.
    """
    if not pipeline.moves:
        raise InputError(f"model {pipeline.card.name!r} cannot start from clips")
    features = features_of(library.motion(take), pipeline.representation)
    texts = [text.strip() for text in sentences if text.strip()]
    captions = tuple(Caption(text, 0, len(features)) for text in texts)
    source = Source(library.folder.name, "unknown", "")
    clip = ShownClip(take.id, source.name, take.title, features, captions)
    encoders = pipeline.feature_encoder, pipeline.text_encoder
    index = build_index([clip], [source], pipeline.card, *encoders).preferred()
    file = library.folder / "moves" / MOVES_FILE
    if file.is_file():
        index = joined([file], index.latent_space, index.text_encoder).joined(index)
    file.parent.mkdir(exist_ok=True)
    index.write(file)
    return len(index.clips), len(index.captions)
