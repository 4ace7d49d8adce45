"""The interface of motion-capture sources, which plugins offer by the hook ``star_mocap_sources``.

A source is a function that yields the frames of a system, `Frame`. It runs in a process of its own:
the code of some systems blocks, with the interpreter's lock held, and cannot be interrupted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import util
from typing import TYPE_CHECKING, Any, NamedTuple

from star_core import InputError, PluginError, Problem
from star_core.toolkit import Spec, fill_defaults, number, positive, suggestion

if TYPE_CHECKING:
    from star_core import Registry, Scene
    from star_mocap.system import MotionCapture

KIND = "mocap_source"


class Frame(NamedTuple):
    """What a system measured at one time, in its own frame.

    Attributes:
        bodies: Poses of labelled bodies by name: x, y, z, m, and quaternion x, y, z, w of the body
            in the system's frame. A body that is not visible is not among them.
        markers: Positions of markers that belong to no body, m.
        captured: Time of the exposure on the system's clock, s; NaN if it has none.
        processing: Time from the exposure until the frame was sent, s; NaN if unknown.
    """

    bodies: Mapping[str, Sequence[float]]
    markers: Sequence[Sequence[float]] = ()
    captured: float = math.nan
    processing: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class MocapSourceSpec(Spec):
    """Announces a source, which ``source: {NAME: {OPTION: VALUE}}`` chooses.

    Attributes:
        frames: ``module:function``; ``function(**options)`` connects, and yields a `Frame` for
            each of the system. The first may take until the timeout of connecting. It may yield
            None while there is none. What it raises is reported, and ends the source.
        options: JSON Schema of those options: an object with ``properties``.
        package: Name of the package that it imports, and what ``pip install`` needs for it; empty
            for none.
        files: Names of the options that are paths of files in the mission's folder.
    """

    frames: str
    options: Mapping[str, Any] = field(default_factory=dict)
    package: tuple[str, str] = ("", "")
    files: tuple[str, ...] = ()

    @staticmethod
    def system_options(registry: Registry) -> dict[str, Any]:
        """Return the schemas of the options of a system by name: source, bodies and frame."""
        sources = registry.offers()[KIND]
        return {
            "source": {
                "type": "object",
                "minProperties": 1,
                "maxProperties": 1,
                "additionalProperties": False,
                "properties": {
                    name: {
                        "type": "object",
                        "additionalProperties": False,
                        "description": offer.summary,
                        **offer.options,
                    }
                    for name, offer in sources.items()
                },
                "description": "The motion-capture system that is connected to: one source and its "
                "options. Needed with a transport that measures no positions.",
                "examples": [{"natnet": {"host": "192.168.1.10"}}],
            },
            "bodies": {
                "type": "object",
                "additionalProperties": {"type": "string", "minLength": 1},
                "default": {},
                "description": "Name of each agent's body in the system, if not the agent's own "
                "name.",
                "examples": [{"cf1": "Crazyflie 1"}],
            },
            "origin": {
                "type": "array",
                "items": {"type": "number"},
                "minItems": 3,
                "maxItems": 3,
                "default": [0.0, 0.0, 0.0],
                "description": "Origin of the system's frame in the map, m.",
            },
            "yaw_deg": number(
                "Direction of the system's x axis in the map, degrees anticlockwise.",
                minimum=-360,
                maximum=360,
                default=0.0,
            ),
            "up": {
                "enum": ["z", "y"],
                "default": "z",
                "description": "Axis of the system's frame that points up. With y, its z axis "
                "points along the map's -y before it is turned by yaw_deg, as in Motive.",
            },
            "connect_timeout": positive(
                "Time within which the system must send its first frame, s.", default=10.0
            ),
        }

    @staticmethod
    def check(registry: Registry, scene: Scene, options: Mapping[str, Any]) -> Iterable[Problem]:
        """Yield why a system with the options of `system_options` cannot be used."""
        ((name, chosen),) = options["source"].items()
        spec = registry.find(KIND, name).offer
        package, install = spec.package
        if package and not installed(package):
            text = f"it needs the package {package!r}: pip install {install}"
            yield Problem(("source", name), text, "missing-package")
        for option in spec.files:
            try:
                scene.file(chosen[option])
            except InputError as error:
                yield Problem(("source", name, option), error.message, error.code)
        bodies = options.get("bodies", {})
        for agent in (name for name in bodies if name not in scene.names):
            text = f"no agent is named {agent!r}{suggestion(agent, scene.names, 'there are')}"
            yield Problem(("bodies", agent), text, "unknown-agent")
        first: dict[str, str] = {}  # agents by their bodies
        for agent in scene.names:
            body = bodies.get(agent, agent)
            if (other := first.setdefault(body, agent)) != agent:
                at = agent if agent in bodies else other
                text = f"body {body!r} is of {other!r} and of {agent!r}; name one for each agent"
                yield Problem(("bodies", at), text, "duplicate-name")

    @staticmethod
    def connect(registry: Registry, scene: Scene, options: Mapping[str, Any]) -> MotionCapture:
        """Return a connected system with the options of `system_options`.

        Raises:
            PluginError: Its package is not installed, it does not answer, or a file does not exist.
        """
        from star_mocap.system import MotionCapture

        for problem in MocapSourceSpec.check(registry, scene, options):
            raise PluginError(f"motion capture: {problem.message}", problem.code)
        schema = {"properties": MocapSourceSpec.system_options(registry)}
        return MotionCapture(registry, scene, fill_defaults(options, schema))


def installed(package: str) -> bool:
    """Return whether a package can be imported."""
    return util.find_spec(package) is not None
