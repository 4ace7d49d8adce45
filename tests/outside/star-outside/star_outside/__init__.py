"""A third party's plugin: the avoider `gentle`, the verb `nod` and the command `star greet`.

Beside it stands `orbit`, a planner for the verb `external`, which has an entry point of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from star_core import Offer, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Scene, Task


@hookimpl
def star_avoiders() -> Iterable[Offer[Avoider]]:
    yield Offer(
        name="gentle",
        summary="Flies a share of what is wanted.",
        make=_gentle,
        options={
            "type": "object",
            "properties": {
                "share": {
                    "type": "number",
                    "minimum": 0,
                    "maximum": 1,
                    "default": 0.9,
                    "description": "Share of the wanted velocity to fly.",
                }
            },
        },
    )


@hookimpl
def star_tasks() -> Iterable[Offer[Task]]:
    yield Offer(
        name="nod",
        summary="Climb and sink again, on the spot.",
        make=_nod,
        options={
            "type": "object",
            "properties": {
                "height": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "default": 0.2,
                    "description": "How far to climb, m.",
                },
                "times": {
                    "type": "integer",
                    "minimum": 1,
                    "default": 1,
                    "description": "How often.",
                },
            },
        },
    )


@hookimpl
def star_commands() -> Iterable[Offer[int]]:
    yield Offer(name="greet", summary="Greet everybody named; exit with their number.", make=_greet)


def _gentle(_scene: Scene, share: float = 0.9) -> Avoider:
    from star_outside.gentle import Gentle

    return Gentle(share)


def _nod(scene: Scene, rows: tuple[int, ...], height: float = 0.2, times: int = 1) -> Task:
    from star_outside.nod import Nod

    return Nod(scene, rows, height, times)


def _greet(arguments: list[str]) -> int:
    for name in arguments:
        print(f"hello {name}")  # noqa: T201 -- a command prints
    return len(arguments)
