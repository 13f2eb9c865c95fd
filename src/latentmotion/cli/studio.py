"""`latentmotion studio`: make, direct, compare and export motions on a page of this machine."""

from __future__ import annotations

import hashlib
import webbrowser
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread

from tyro.conf import UseAppendAction

from latentmotion.cli import options
from latentmotion.cli.serve import ExportedRuntime
from latentmotion.errors import InputError, MissingExtraError
from latentmotion.model.card import DEFAULT


@dataclass(frozen=True)
class Studio:
    """Make, direct, compare and export motions on a page of this machine.

    Example: latentmotion studio --library my_motions
    """

    model: UseAppendAction[tuple[str, ...]] = ()
    """Name or folder of an exported model, fast by default; given several times, the page offers
    them all, and those that ship, and starts with the first."""
    host: str = "127.0.0.1"
    """Address to listen at; by default only this machine is let in."""
    port: int = 8765
    """Port to listen at; 0 for any free one."""
    hosts: tuple[str, ...] = ()
    """Names by which the page may be called; by default those of this machine, or, where other
    machines are let in, any."""
    library: Path | None = None
    """Folder of takes, characters and projects; by default one in the user's folder for data."""
    browser: bool = True
    """Open the page in the browser."""
    moves: options.Moves = ()
    runtime: ExportedRuntime = "auto"
    deadline: float = 120.0
    """Seconds that a request may take."""

    def run(self) -> None:
        """Serves until SIGTERM or Ctrl+C.

        Raises:
            InputError: An option cannot be used, the address is taken, or the folder is none.
            MissingExtraError: FastAPI and what it needs are not installed.
        """
        from latentmotion.service.settings import LOOPBACK, Settings

        if self.runtime == "pytorch":
            raise InputError("--runtime pytorch cannot be served; export the model first")
        settings = Settings(
            model=(self.model or (DEFAULT,))[0],
            moves=tuple(path.resolve() for path in self.moves),
            runtime=self.runtime,
            deadline=self.deadline,
            file_workers=1,
            start_workers=True,
            hosts=self.hosts or (LOOPBACK if self.host in LOOPBACK else ()),
        )
        try:
            from latentmotion.service.server import address, bound, serve
            from latentmotion.studio.app import create_studio
            from latentmotion.studio.library import Library, default_folder
            from latentmotion.studio.session import kept_token, redirecting_page
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("latentmotion"):
                raise
            raise MissingExtraError("latentmotion studio", error.name, "studio") from error
        with bound(self.host, self.port) as listener:
            library = Library((self.library or default_folder()).expanduser().resolve())
            token = kept_token(library.folder)
            settings = replace(settings, tokens=(hashlib.sha256(token.encode()).digest(),))
            app = create_studio(settings, library, self.model[1:])
            # Behind #, so that neither a log nor another page ever sees it; a browser is started
            # with a file that leads there, so that no list of processes has it either.
            page = f"{address(listener)}/studio#token={token}"
            print(page, flush=True)
            if self.browser:  # in a thread, since a browser of the terminal holds the server up
                place = redirecting_page(library.folder, page).as_uri()
                Thread(target=webbrowser.open, args=(place,), daemon=True).start()
            serve(app, listener, 0.0, 5.0)
