"""Keeps cflib quiet: no word on standard output, and no thread that spins after the end."""

from __future__ import annotations

import logging
from contextlib import suppress
from importlib import import_module
from typing import Any

log = logging.getLogger(__name__)

TALKATIVE = ("cflib.cpx.transports", "cflib.crtp.radiodriver", "cflib.crtp.tcpdriver")
"""Modules of cflib 0.1.34 that print while links are opened, closed or broken."""

ALARMED = ("cflib.cpx",)
"""Those that print a traceback whenever a link is closed, and in a loop when it has broken."""


def hush() -> None:
    """Turn cflib's prints into debug messages, and let it log nothing.

    A module's own ``print`` hides the built-in one, so nobody else's output is touched.
    """
    for name in TALKATIVE:
        vars(import_module(name))["print"] = _say
    for name in ALARMED:
        vars(import_module(name))["print"] = _say_nothing
    logging.getLogger("cflib").setLevel(logging.CRITICAL)


def end(driver: Any) -> None:
    """Close a driver; one for TCP would else read from a connection that is gone for ever.

    In cflib 0.1.34 its reader takes no notice of the end of a stream: it asks again at once, until
    its transport has no socket any more.

    Raises:
        Exception: What the driver raises.
    """
    transport = getattr(getattr(getattr(driver, "cpx", None), "_router", None), "_transport", None)
    try:
        driver.close()
    finally:
        socket = getattr(transport, "_socket", None)
        if socket is not None:
            vars(transport)["_socket"] = None
            with suppress(OSError):
                socket.close()


def _say_nothing(*_words: object, **_options: object) -> None:
    """Print nothing: that a link is gone is told by who used it."""


def _say(*words: object, **_options: object) -> None:
    log.debug("cflib: %s", " ".join(str(word) for word in words))
