"""The verbs together, and the one place where errors end."""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING

from cyclopts import App, CycloptsError

import mvmatch
from mvmatch.cli import bench, models, runs, stages
from mvmatch.cli.console import Outcome, describe, show, show_error, show_notes
from mvmatch.cli.convert import convert
from mvmatch.cli.demo import demo
from mvmatch.cli.settings import UsageError
from mvmatch.errors import MvmatchError

if TYPE_CHECKING:
    from collections.abc import Sequence

_HELP = """Motion vectors of AV1 video as correspondences, tracks and COLMAP models.

The shortest way: `mvmatch run VIDEO -o out`. Exit codes: 0 done, 1 the data or a part of the result
is at fault, 2 the command line is."""


def build_app() -> App:
    """Return the command line."""
    app = App(
        name="mvmatch", help=_HELP, version=mvmatch.__version__, suppress_keyboard_interrupt=False
    )
    verbs = (
        runs.run,
        stages.probe,
        stages.encode,
        stages.extract,
        stages.track,
        models.export,
        models.score,
        models.reconstruct,
        convert,
        stages.encoders,
        demo,
    )
    for position, verb in enumerate(verbs):
        app.command(verb, sort_key=position)
    app.command(bench.app)
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Words after the program's name; those of the process without.

    Returns
    -------
    int
        0 done, 1 fault in the data (or only a part could be done), 2 fault in the command line,
        130 interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in words
    try:
        outcome = build_app()(
            words, exit_on_error=False, print_error=False, result_action="return_value"
        )
        if isinstance(outcome, Outcome):
            show(outcome, verb=words[0], as_json=as_json)
            sys.stdout.flush()
            return 0 if outcome.failure is None else 1
    except CycloptsError as error:
        return _refuse(
            error, "`mvmatch --help` lists the verbs, `mvmatch VERB --help` their words."
        )
    except (UsageError, FileNotFoundError) as error:
        return _refuse(error, f"See `mvmatch {words[0]} --help`.")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (MvmatchError, OSError) as error:
        if as_json:
            print(json.dumps({"verb": words[0], "error": describe(error)}))
        show_error(error)
        return 1
    except KeyboardInterrupt as interrupt:
        kept = hasattr(interrupt, "__notes__")
        print(f"interrupted{'' if kept else ': nothing was left behind'}", file=sys.stderr)
        show_notes(interrupt)
        return 130
    return 0


def _refuse(error: Exception, advice: str) -> int:
    print(f"usage: {str(error).strip()}", file=sys.stderr)
    print(f"       {advice}", file=sys.stderr)
    return 2
