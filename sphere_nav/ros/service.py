"""A service answers every request: with success, or with one line, and the node goes on with what it has."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from sphere_nav.geometry.files.untrusted import printable
from sphere_nav.params.homes import at_home
from sphere_nav.ros.constants import LOG_PERIOD_S
from sphere_nav.ros.conversions.headers import plain_frames

Handler = Callable[[Any, Any], Any]
MAX_LINE = 600  # characters: what was found may be a whole file


def answer_always(handler: Handler, name: str, log: Any) -> Handler:
    """Return the handler with every exception turned into `success: false` and one line.

    ValueError and OSError say what is wrong with the request. Anything else is a mistake of ours: the log, a
    ThrottledLog, gets where it came from, too, for whoever mends it. Requests that fail alike are told once in a while.
    A response without those fields is returned empty. A `path` of the request may begin with `~/`.
    """

    def answer(request: Any, response: Any) -> Any:
        try:
            if isinstance(path := getattr(request, "path", None), str):
                request.path = at_home(path)
            return handler(plain_frames(request), response)
        except Exception as error:
            refused = type(response)()
            if hasattr(refused, "success"):
                refused.success, refused.message = False, one_line(error)
            is_ours = not isinstance(error, ValueError | OSError)
            text = traceback.format_exc().rstrip() if is_ours else one_line(error)
            log.error(f"{name}: {text}", every=LOG_PERIOD_S, key=f"service {name}: {type(error).__name__}")
            return refused

    return answer


def one_line(error: BaseException) -> str:
    """Return what an error says in one line, a file's name included, or its kind where it says nothing.

    All that is refused is told through here: by services, inputs of nodes, commands. A long line loses its middle.
    """
    text = printable(str(error))
    if isinstance(error, OSError) and error.strerror:
        text = printable(f"{error.filename}: {error.strerror}" if error.filename else error.strerror)
    elif not (isinstance(error, ValueError | OSError) and text):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return text if len(text) <= MAX_LINE else f"{text[: MAX_LINE // 2]} ... {text[-MAX_LINE // 4 :]}"
