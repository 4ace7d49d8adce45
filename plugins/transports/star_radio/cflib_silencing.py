"""Silences cflib: redirects its prints, and stops a thread that would spin after closing."""

from __future__ import annotations

import logging
from contextlib import suppress
from importlib import import_module
from typing import Any

log = logging.getLogger(__name__)

PRINTING_MODULES = ("cflib.cpx.transports", "cflib.crtp.radiodriver", "cflib.crtp.tcpdriver")
"""Modules of cflib 0.1.34 that print while links are opened, closed or broken."""

TRACEBACK_MODULES = ("cflib.cpx",)
"""Modules that print a traceback when a link is closed, and in a loop when it has broken."""


def silence_cflib() -> None:
    """Turn cflib's prints into debug messages, and disable its logging.

    A module-level ``print`` shadows the built-in one, so the output of other modules is unaffected.
    """
    for name in PRINTING_MODULES:
        vars(import_module(name))["print"] = _log
    for name in TRACEBACK_MODULES:
        vars(import_module(name))["print"] = _ignore
    logging.getLogger("cflib").setLevel(logging.CRITICAL)


def close_driver(driver: Any) -> None:
    """Close a driver and, for TCP, its socket.

    The TCP reader of cflib 0.1.34 ignores the end of the stream and reads again at once, until its
    transport has no socket.

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


def _ignore(*_words: object, **_options: object) -> None:
    """Print nothing: the loss of a link is reported by its user."""


def _log(*words: object, **_options: object) -> None:
    log.debug("cflib: %s", " ".join(str(word) for word in words))
