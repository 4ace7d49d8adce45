"""Avoider ``gentle``, verb ``nod``, transport ``points`` and command ``star greet``."""

from star_core import AvoiderSpec, CommandSpec, TaskSpec, TransportSpec, hookimpl


def make(scene, share):
    from star_gentle.avoider import Gentle

    return Gentle(share)


@hookimpl
def star_avoiders():
    yield AvoiderSpec(
        name="gentle",
        summary="Flies a share of the wanted velocity.",
        make=make,
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


def make_nod(scene, rows, height):
    from star_gentle.nod import Nod

    return Nod(scene, rows, height)


@hookimpl
def star_tasks():
    yield TaskSpec(
        name="nod",
        summary="Climb and sink again, on the spot.",
        make=make_nod,
        options={
            "type": "object",
            "properties": {
                "height": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "default": 0.2,
                    "description": "How far to climb, m.",
                }
            },
        },
        before="air",
        after="same",
    )


def make_points(scene):
    from star_gentle.points import Points

    return Points(scene)


@hookimpl
def star_transports():
    yield TransportSpec(
        name="points", summary="Simulates agents without dynamics.", make=make_points
    )


def greet(arguments):
    for name in arguments:
        print(f"hello {name}")
    return len(arguments)


@hookimpl
def star_commands():
    yield CommandSpec(
        name="greet", summary="Greet the given names; exit with their number.", make=greet
    )
