"""`latentmotion VERB …`: runs a verb; wrong input ends in one line and exit code 2."""

from __future__ import annotations

import errno
import os
import sys
import warnings
from collections.abc import Sequence
from importlib import import_module

from latentmotion import __version__
from latentmotion.cli import VERBS, Verb
from latentmotion.errors import InputError, LatentMotionError, MissingExtraError, hint
from latentmotion.progress import shown_progress


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line.

    Exit codes: 0 success, 2 wrong input (explained on standard error), 130 interrupted, 141 the
    reader of the output has gone, as for any program whose pipe is closed.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with warnings.catch_warnings():
            printed: set[str] = set()

            def tell_once(message: Warning | str, *_: object, **__: object) -> None:
                if str(message) not in printed:
                    printed.add(str(message))
                    print(f"warning: {message}", file=sys.stderr)

            warnings.showwarning = tell_once
            _run(words)
            print(end="", flush=True)  # unlike sys.stdout.flush, also where there is no stdout
    except LatentMotionError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        # 128 + SIGINT, as shells report it.
        raise SystemExit(130) from None
    except BrokenPipeError:
        _close_output()
        # 128 + SIGPIPE.
        raise SystemExit(141) from None
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT) or error.filename is not None:
            raise
        _close_output()
        print(f"error: cannot write the output: {error.strerror}", file=sys.stderr)
        raise SystemExit(2) from None


def _close_output() -> None:
    """Sends the rest of standard output to the null device, since Python flushes it once more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(words: list[str]) -> None:
    """Runs a verb, or prints the overview or the version."""
    if not words or words[0] in ("-h", "--help"):
        print(_overview(VERBS))
        return
    if words[0] == "--version":
        print(f"latentmotion {__version__}")
        return
    # The longest first: `convert evaluator` is a command beside `convert`.
    name = next((" ".join(words[:n]) for n in (3, 2, 1) if " ".join(words[:n]) in VERBS), None)
    if name is None:  # a group of verbs such as `data`, or a mistake
        depth = next((n for n in (2, 1) if n <= len(words) and _group(words[:n])), 0)
        group = _group(words[:depth])
        if depth and (len(words) == depth or words[depth] in ("-h", "--help")):
            print(_overview(group))
            return
        typed = " ".join(words[: depth + 1])
        # One word further than what was understood, so that "xyz" is no reason to name every verb.
        names = dict.fromkeys(" ".join(verb.split()[: depth + 1]) for verb in group)
        verbs = [verb for verb in group if words[depth] in verb.split()[depth + 1 :]]
        advice = f"did you mean {verbs[0]!r}?" if verbs else hint(typed, names)
        raise InputError(f"unknown command {typed!r}; {advice}")
    from latentmotion.cli.usage import parsed

    module, _, cls = VERBS[name].target.partition(":")
    try:
        command = getattr(import_module(f"latentmotion.cli.{module}"), cls)
        job = parsed(command, name, words[len(name.split()) :])
        endless = name in ("serve", "studio")  # they say what they do in a log
        with shown_progress(quiet=endless or getattr(job, "json", False)):
            job.run()
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("latentmotion"):
            raise
        extra = name if name in ("serve", "studio", "mcp", "mmcp") else "train"
        raise MissingExtraError(f"latentmotion {name}", error.name, extra) from error


def _group(words: list[str]) -> dict[str, Verb]:
    return {name: verb for name, verb in VERBS.items() if name.split()[: len(words)] == words}


def _overview(verbs: dict[str, Verb]) -> str:
    lines = [f"  {name:<25}{verb.purpose}" for name, verb in verbs.items()]
    usage = "usage: latentmotion COMMAND [OPTIONS]     (COMMAND --help lists its options)"
    return "\n".join([usage, "", *lines])
