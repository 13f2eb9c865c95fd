"""The library: takes in SQLite, their motions as files named by their content.

    library.sqlite3        takes and characters (write-ahead log, so that readers never wait)
    motions/SHA256.npz     motions as they were made; none is ever changed
    characters/ID.glb      figures of the user
    projects/NAME.json

A take is a row; its edits are settings, and to delete it is a mark. Names of files are made here
and come from no request.

Edits are settings of a take that are applied whenever its motion is read, never stored in it.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from threading import RLock
from typing import Any, Literal, TypeVar
from uuid import uuid4

import numpy as np

from latentmotion.cleanup.pipeline import in_place
from latentmotion.errors import DiskFullError, FileFormatError, InputError, LatentMotionError
from latentmotion.formats import npz
from latentmotion.formats.content import encoded
from latentmotion.language.words import other_forms
from latentmotion.motion import Motion
from latentmotion.retarget.rig import RigReport
from latentmotion.storage import configuration, files, reading

SLOWEST, FASTEST = 0.1, 10.0  # Least and greatest speed.


@dataclass(frozen=True)
class Edits:
    """How a stored motion is shown and written: first in place, then trimmed, mirrored, sped up.

    Raises:
        InputError: A number is out of range.
    """

    trim: tuple[float, float] | None = None  # Start and end, seconds of the stored motion.
    speed: float = 1.0  # Playback speed factor: the frames stay, their rate changes.
    in_place: bool = False  # Without root motion along the floor.
    mirrored: bool = False  # Left and right are swapped.

    def __post_init__(self) -> None:
        if not SLOWEST <= self.speed <= FASTEST:
            raise InputError(f"speed {self.speed:g}: expected {SLOWEST:g} to {FASTEST:g}")

    def applied(self, motion: Motion) -> Motion:
        """Returns an edited motion; without edits the same.

        Raises:
            InputError: There is no frame between the times of the trim.
        """
        if self.in_place:
            joints = in_place(motion.joints.astype(np.float64), motion.fps).astype(np.float32)
            motion = replace(motion, joints=joints)
        if self.trim is not None:
            motion = motion.cut(*self.trim)
        if self.mirrored:
            motion = motion.mirrored()
        return replace(motion, fps=motion.fps * self.speed) if self.speed != 1 else motion

    def length(self, frames: int, fps: float) -> tuple[int, float]:
        """Returns frames and frames per second of a motion of such a length once it is edited.

        Raises:
            InputError: There is no frame between the times of the trim.
        """
        start, end = self.trim or (0.0, frames / fps)
        first, stop = round(start * fps), round(end * fps)
        if not 0 <= first < stop <= frames:
            raise InputError(
                f"trim from {start:g} to {end:g} s: expected times in order, from 0 to "
                f"{frames / fps:g} s, at least a frame apart"
            )
        return stop - first, fps * self.speed


P = TypeVar("P")

VERSION = 1  # Version of the database that this code writes and reads.

# Pattern of the names of takes and characters: UUIDs in hexadecimal; libraries have ULIDs, too.
ID = "[0-9A-Za-z]{26,32}"

MOST_TITLE = 200  # Longest title, characters.

MOST_LISTED = 500  # Most takes on one page of the list.

_EACH_TAG = "json_each(CASE WHEN json_valid(tags) THEN tags ELSE '[]' END)"
_TABLES = Path(__file__).with_name("library.sql").read_text(encoding="utf-8")


class UnknownError(InputError):
    """There is no such take, character or project."""


class MissingMotionError(InputError):
    """The file of a take's motion is missing or damaged."""


@dataclass(frozen=True)
class StoredTake:
    """A motion of the library with its recipe, edits and marks."""

    id: str  # Its name in the library.
    created: str  # When it was made, ISO 8601.
    title: str  # What the list shows.
    recipe: Mapping[str, Any]  # What makes it again, or `imported` with the name of a file.
    motion: str  # SHA-256 of the file of its motion.
    stored_frames: int  # Frames of the stored motion, before edits.
    stored_fps: float  # Its frames per second.
    tags: tuple[str, ...] = ()  # Words of the user's choice.
    star: bool = False  # Marked as good.
    deleted: bool = False  # Marked as deleted.
    edits: Edits = field(default_factory=Edits)  # What is applied when the motion is read.
    # Each goal, and how far the motion was from it, centimeters.
    goals: Sequence[Mapping[str, Any]] | None = None
    missing: bool = False  # The file of its motion is gone.
    damaged: bool = False  # Its row in the database cannot be read.

    def about(self) -> dict[str, Any]:
        """Returns the take as JSON has it; frames, rate and seconds are those after its edits."""
        frames, fps = self.edits.length(self.stored_frames, self.stored_fps)
        lengths = {"frames": frames, "fps": fps, "seconds": frames / fps}
        stored = {"stored_seconds": self.stored_frames / self.stored_fps}
        about = {**vars(self), **lengths, **stored, "edits": asdict(self.edits)}
        return {**about, "made": about.pop("created")}

    def words(self) -> str:
        """Returns the text in which the search looks."""
        tracks = (self.recipe.get(name) or () for name in ("timeline", "timeline_parts"))
        spans = [span.get("prompt", "") for track in tracks for span in track]
        texts = (self.title, self.recipe.get("prompt", ""), self.recipe.get("imported") or "")
        return "\n".join([*texts, *spans, *self.tags]).casefold()


@dataclass(frozen=True)
class Character:
    """A figure of the user."""

    id: str  # Its name in the library.
    name: str  # Its name for the user.
    ending: str  # `glb` or `bvh`.
    # Its bones and which of them are our joints, as `inspect_rig` reports them.
    bones: Mapping[str, Any]
    deleted: bool = False  # Marked as deleted.

    def about(self) -> dict[str, Any]:
        """Returns the character as JSON has it."""
        return {"id": self.id, "name": self.name, "deleted": self.deleted, **self.bones}

    def joint_map(self) -> dict[str, str]:
        """Returns our joints → its bones.

        Raises:
            InputError: Bones are missing or do not fit.
        """
        if self.bones["problem"]:
            raise InputError(
                f"no motion can be put on {self.name!r} yet: {self.bones['problem']}; correct the "
                "names of its bones first"
            )
        return {ours: bone for ours, bone in self.bones["mapping"].items() if bone is not None}


class Library:
    """Takes and characters of a folder, safe for threads and for several processes.

    Args:
        folder: The folder, which is made.

    Raises:
        InputError: It cannot be made or written, or holds something else under these names.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)  # prompts are nobody else's business
            with suppress(PermissionError):  # someone else's library, which may be shared
                folder.chmod(0o700)
            for name in ("motions", "characters", "projects"):
                (folder / name).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"--library {folder}: cannot be written ({error.strerror}); name another folder"
            ) from error
        self._lock = RLock()
        try:
            path = folder / "library.sqlite3"
            path.touch(mode=0o600)
            if files.is_durable(path):
                files.sync_names(path)
            self._database = sqlite3.connect(
                path, timeout=10.0, isolation_level=None, check_same_thread=False
            )
            self._database.row_factory = sqlite3.Row
            (version,) = self._database.execute("PRAGMA user_version").fetchone()
            if version > VERSION:
                raise InputError(f"{path} is of version {version}; update latentmotion")
            # A take that was answered for is there after a power cut; readers never wait for a
            # writer.
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = FULL")
            self._database.executescript(f"{_TABLES} PRAGMA user_version = {VERSION};")
        except sqlite3.Error as error:
            if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_FULL:
                raise DiskFullError(f"--library {folder}: the disk is full; make room") from error
            raise InputError(
                f"{folder / 'library.sqlite3'} is no library that can be used ({error}); move it "
                "away, or name another folder by --library"
            ) from error

    def close(self) -> None:
        """Closes the database."""
        with self._lock:
            self._database.close()

    def add(
        self, motions: Iterable[tuple[Motion, Mapping[str, Any], str, Edits]]
    ) -> list[StoredTake]:
        """Keeps motions; returns their takes.

        Args:
            motions: Motion, recipe, title and edits of each.

        Raises:
            InputError: The folder cannot be written.
        """
        takes = []
        for motion, recipe, title, edits in motions:
            goals = [
                {
                    "goal": {k: v for k, v in goal.items() if k not in ("before", "after")},
                    "before_cm": 1e2 * goal["before"],
                    "after_cm": 1e2 * goal["after"],
                }
                for goal in motion.metadata.get("goals", ())
                if "unit" not in goal  # those of angles
            ]
            takes.append(
                StoredTake(
                    uuid4().hex,
                    _now(),
                    title[:MOST_TITLE],
                    recipe,
                    self.store(motion),
                    len(motion),
                    motion.fps,
                    edits=edits,
                    goals=goals or None,
                )
            )
        self._insert(takes)
        return takes

    def duplicate(self, name: str) -> StoredTake:
        """Returns a new take of the same motion, with the same recipe, tags and edits.

        Raises:
            UnknownError: There is none of this name.
        """
        original = self.take(name)
        title = f"{original.title[: MOST_TITLE - 7]} (copy)"
        take = replace(
            original, id=uuid4().hex, created=_now(), title=title, star=False, deleted=False
        )
        self._insert([take])
        return take

    def _insert(self, takes: Sequence[StoredTake]) -> None:
        with self._written() as database:
            database.executemany(
                "INSERT INTO takes VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", map(_row, takes)
            )

    def take(self, name: str) -> StoredTake:
        """Returns a take.

        Raises:
            UnknownError: There is none of this name.
        """
        return self._take(self._row_named(name, "take"))

    def _row_named(self, name: str, kind: Literal["take", "character"]) -> sqlite3.Row:
        with self._lock:
            query = f"SELECT * FROM {kind}s WHERE id = ?"
            row = self._database.execute(query, (name,)).fetchone()
        if row is None:
            raise UnknownError(f"there is no {kind} {name[:40]!r} in this library")
        return row

    def takes(
        self,
        query: str = "",
        tag: str = "",
        star: bool | None = None,
        deleted: bool = False,
        offset: int = 0,
        limit: int = 100,
    ) -> tuple[int, list[StoredTake]]:
        """Returns how many takes there are of a kind, and some of them, the newest first.

        Args:
            query: Words, each of which a take's title, prompts or tags have in some form: "sitting"
                finds "sits" and "sat".
            tag: A tag that it has.
            star: Whether it is marked; None for any.
            deleted: Whether it is marked as deleted.
            offset: Takes to leave out.
            limit: Takes to return at most.
        """
        conditions: list[str] = ["deleted = ?"]
        values: list[str | int] = [int(deleted)]
        # Each word costs a scan of all takes: twenty are more than anybody types.
        for word in query.casefold().split()[:20]:
            # The beginnings of all forms of a word that is searched for.
            forms = {word, *(form for form in other_forms(word) if len(form) > 2)}
            forms = [
                form for form in sorted(forms) if not any(o in form for o in forms if o != form)
            ]
            conditions.append(f"({' OR '.join(['instr(words, ?)'] * len(forms))})")
            values.extend(forms)
        if tag:
            conditions.append(f"tags <> '[]' AND ? IN (SELECT value FROM {_EACH_TAG})")
            values.append(tag)
        if star is not None:
            conditions.append("star = ?")
            values.append(int(star))
        where = " AND ".join(conditions)
        with self._lock:
            (total,) = self._database.execute(
                f"SELECT count(*) FROM takes WHERE {where}", values
            ).fetchone()
            rows = self._database.execute(
                f"SELECT * FROM takes WHERE {where} ORDER BY rowid DESC LIMIT ? OFFSET ?",
                (*values, limit, offset),
            ).fetchall()
        return total, [self._take(row) for row in rows]

    def tags(self) -> list[str]:
        """Returns the tags of all takes that are not deleted."""
        with self._lock:
            rows = self._database.execute(
                f"SELECT DISTINCT value FROM takes, {_EACH_TAG} "
                "WHERE deleted = 0 AND tags <> '[]' AND typeof(value) = 'text' ORDER BY value"
            ).fetchall()
        return [tag for (tag,) in rows]

    def change(self, name: str, **changes: Any) -> StoredTake:
        """Changes title, tags, star, deleted or edits of a take; returns it.

        Raises:
            UnknownError: There is none of this name.
            InputError: The edits leave no frame.
        """
        with self._written() as database:
            take = replace(self.take(name), **changes)
            take.edits.length(take.stored_frames, take.stored_fps)
            row = _row(take)
            database.execute(
                "UPDATE takes SET title = ?, tags = ?, star = ?, deleted = ?, edits = ?, words = ? "
                "WHERE id = ?",
                (row[2], *row[7:11], row[12], name),
            )
        return take

    def motion(self, take: StoredTake) -> Motion:
        """Returns the motion of a take, edited.

        Raises:
            MissingMotionError: Its file is gone or damaged.
        """
        return take.edits.applied(self.stored(take.motion))

    def stored(self, digest: str) -> Motion:
        """Returns a motion as it was made.

        Raises:
            MissingMotionError: Its file is gone or damaged.
        """
        path = self._motion_file(digest)
        try:
            return npz.read_motions(path)[0]
        except (FileFormatError, IndexError) as error:
            problem = "is damaged" if path.is_file() else "is missing"
            raise MissingMotionError(
                f"the motion of this take {problem} ({path.name} in {path.parent}); make it again "
                "from its recipe, or put the file back"
            ) from error

    def store(self, motion: Motion) -> str:
        """Keeps a motion; returns the SHA-256 of its file."""
        content, _ = encoded([motion], "npz")
        digest = hashlib.sha256(content).hexdigest()
        path = self._motion_file(digest)
        if not path.is_file():
            files.write_file(path, content)
        return digest

    def add_character(self, name: str, file: Path, bones: Mapping[str, Any]) -> Character:
        """Keeps a copy of a character's file; returns the character.

        Args:
            name: Name that the user gives it.
            file: The file.
            bones: Its bones by joint, as far as they are known.

        Raises:
            InputError: The folder cannot be written.
        """
        character = Character(uuid4().hex, name, file.suffix[1:], bones)
        with files.atomic_file(self.character_file(character)) as temporary:
            shutil.copyfile(file, temporary)
        with self._written() as database:
            row = character.id, name, character.ending, json.dumps(bones), 0
            database.execute("INSERT INTO characters VALUES (?, ?, ?, ?, ?)", row)
        return character

    def character(self, name: str) -> Character:
        """Returns a character.

        Raises:
            UnknownError: There is none of this name.
        """
        return _character(self._row_named(name, "character"))

    def characters(self, deleted: bool = False) -> list[Character]:
        """Returns all characters, the newest first.

        Args:
            deleted: Whether they are marked as deleted.
        """
        with self._lock:
            rows = self._database.execute(
                "SELECT * FROM characters WHERE deleted = ? ORDER BY rowid DESC", (int(deleted),)
            ).fetchall()
        return [_character(row) for row in rows]

    def change_character(self, name: str, **changes: Any) -> Character:
        """Changes name, bones or deleted of a character; returns it.

        Raises:
            UnknownError: There is none of this name.
        """
        with self._written() as database:
            character = replace(self.character(name), **changes)
            database.execute(
                "UPDATE characters SET name = ?, bones = ?, deleted = ? WHERE id = ?",
                (character.name, json.dumps(character.bones), int(character.deleted), name),
            )
        return character

    def character_file(self, character: Character) -> Path:
        """Returns the file of a character."""
        return self.folder / "characters" / f"{character.id}.{character.ending}"

    def compare(self, take: StoredTake, motion: Motion) -> tuple[bool, bool]:
        """Returns whether a motion is a take's to the bit, and whether its file was written again.

        Args:
            take: The take.
            motion: Its motion, made again; it is kept where the take's file is missing and this
                has the same content.
        """
        path = self._motion_file(take.motion)
        if path.is_file():
            stored = self.stored(take.motion)
            equal = stored.joints.tobytes() == motion.joints.tobytes()
            return equal and (stored.fps, stored.caption) == (motion.fps, motion.caption), False
        content, _ = encoded([motion], "npz")
        if hashlib.sha256(content).hexdigest() != take.motion:
            return False, False
        return self.store(motion) == take.motion, True

    def _motion_file(self, digest: str) -> Path:
        if not re.fullmatch("[0-9a-f]{64}", digest):
            raise MissingMotionError(
                f"no motion has the name {digest[:80]!r}: this take is damaged"
            )
        return self.folder / "motions" / f"{digest}.npz"

    def _take(self, row: sqlite3.Row) -> StoredTake:
        """Returns the take of a row; one that cannot be read is there as damaged."""
        try:
            texts = [row[name] for name in ("id", "made", "title", "motion")]
            if not all(isinstance(text, str) for text in texts):
                raise ValueError("expected text")
            name, at, title, digest = texts
            take = StoredTake(
                name,
                at,
                title,
                _parsed(row["recipe"], dict),
                digest,
                row["frames"],
                row["fps"],
                tuple(_parsed(row["tags"], list)),
                bool(row["star"]),
                bool(row["deleted"]),
                configuration.from_json(Edits, _parsed(row["edits"], dict)),
                _parsed(row["goals"], list) if row["goals"] else None,
                not self._motion_file(digest).is_file(),
            )
            seconds = take.about()["seconds"]  # and its edits fit its length
            if not 0 < seconds < inf or not all(
                isinstance(each, dict) for each in take.goals or ()
            ):
                raise ValueError("its numbers or goals")
            take.words()  # its recipe and tags are of text
            return take
        except (ValueError, TypeError, AttributeError, ArithmeticError, LatentMotionError) as error:
            reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
            name, at, digest = (str(row[name])[:MOST_TITLE] for name in ("id", "made", "motion"))
            # Listed in spite of it, so that one damaged row hides no others and can be deleted.
            title = "damaged: its row in library.sqlite3 cannot be read"
            return StoredTake(
                *(name, at, title, {"damaged": reason}, digest, 1, 1.0),
                deleted=bool(row["deleted"]),
                missing=True,
                damaged=True,
            )

    @contextmanager
    def _written(self) -> Iterator[sqlite3.Connection]:
        """Yields the database in a transaction, which is rolled back on errors."""
        with self._lock:
            self._database.execute("BEGIN IMMEDIATE")
            try:
                yield self._database
            except BaseException:
                self._database.execute("ROLLBACK")
                raise
            self._database.execute("COMMIT")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def default_folder() -> Path:
    """Returns the folder for this user's library, as the platform has it."""
    folder = files.user_folder("XDG_DATA_HOME", ".local/share", "Library/Application Support")
    return folder / "library"


def _character(row: sqlite3.Row) -> Character:
    """Returns the character of a row; of one that cannot be read, the bones' problem says so."""
    try:
        bones = asdict(configuration.from_json(RigReport, _parsed(row["bones"], dict)))
    except (ValueError, TypeError, LatentMotionError) as error:
        problem = f"its row in library.sqlite3 cannot be read ({error})"
        bones = asdict(RigReport((), {}, (), (), problem))
    name, title, ending = (str(row[name])[:MOST_TITLE] for name in ("id", "name", "ending"))
    return Character(name, title, ending, bones, bool(row["deleted"]))


def _parsed(text: str, kind: type[P]) -> P:
    """Returns what a column holds as JSON.

    Raises:
        FileFormatError: It is no JSON, or of another kind.
    """
    value = reading.parse_json(text, "library.sqlite3")
    if not isinstance(value, kind):
        raise FileFormatError("library.sqlite3", f"found {value!r:.40}, expected a {kind.__name__}")
    return value


def _row(take: StoredTake) -> tuple[Any, ...]:
    return (
        *(take.id, take.created, take.title, json.dumps(take.recipe), take.motion),
        *(take.stored_frames, take.stored_fps, json.dumps(take.tags)),
        *(int(take.star), int(take.deleted), json.dumps(asdict(take.edits))),
        *(json.dumps(take.goals) if take.goals else None, take.words()),
    )
