"""What is wrong with the options of ``external`` that a schema cannot see."""

from __future__ import annotations

from collections.abc import Iterator
from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING, Any

from star_core import Problem
from star_external.rates import ticks_between

if TYPE_CHECKING:
    from star_core import Scene


def check(scene: Scene, _rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    """Yield an address that is none, and a silence that is over before the next state line."""
    if "listen" in options:
        try:
            IPv4Address(options["listen"])
        except AddressValueError:
            yield Problem(
                ("listen",),
                f"{options['listen']!r} is no IPv4 address, expected one like 127.0.0.1",
            )
    apart = ticks_between(options.get("rate"), scene.period) * scene.period
    silence = options.get("silence", 2.0)
    if silence <= apart:
        path = ("silence",) if "silence" in options else ("rate",)
        yield Problem(
            path,
            f"a silence of {silence:g} s is not longer than from one state line to the next, "
            f"{apart:g} s",
        )
