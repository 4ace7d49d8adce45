"""Transport ``sim``: simulated Crazyflies with Flow decks, in lock-step with the mission."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from star_core import Problem, TransportSpec, deferred, hookimpl
from star_core.toolkit import fill_defaults, number, positive
from star_sim.camera_sim import options as camera_options
from star_sim.error_profile import PROFILES
from star_sim.positioning_options import ONBOARD, POSITIONING

if TYPE_CHECKING:
    from star_core import Scene, Transport


OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "profile": {
            "enum": ["realistic", "ideal"],
            "default": "realistic",
            "description": "Magnitudes of the errors of sensors, radio link, cameras and survey. "
            "realistic: as of a Crazyflie with a Flow deck in a careful lab; its ranger sees "
            "obstacles below. ideal: a drifting Flow deck, an exact IMU, no delay, no loss.",
        },
        "noise": {
            "type": "boolean",
            "default": True,
            "description": "Whether on-board estimates have the errors and drift of a Flow deck; "
            "without noise they equal the ground truth.",
        },
        "controller": {
            "enum": ["pid", "mellinger", "ideal"],
            "default": "pid",
            "description": "What flies the drones: 'pid' and 'mellinger' are the firmware's "
            "controllers with motors and battery identified from real flights; 'ideal' feeds "
            "velocity and acceleration of trajectories forward and has stronger motors.",
        },
        "battery": number(
            "Initial charge of every battery, as a fraction of full.",
            minimum=0,
            maximum=1,
            default=1.0,
        ),
        "endurance": positive("Hover time with a full battery, s.", default=420.0),
        "swap_time": {
            "type": ["number", "null"],
            "minimum": 0,
            "default": None,
            "description": "Time on the ground after a flight until the battery is replaced, s; "
            "null never replaces it.",
        },
        "speed": {
            "type": ["number", "null"],
            "exclusiveMinimum": 0,
            "default": None,
            "description": "Simulation speed: mission seconds per second of wall time, 1 is real "
            "time; null is as fast as possible.",
        },
        "aerodynamics": {
            "type": "boolean",
            "description": "Whether drones feel the downwash of those above and the ground effect; "
            "by default as in the profile: realistic has them.",
        },
        "wind": {
            "type": "object",
            "additionalProperties": False,
            "description": "Wind and its gusts; still air if not given.",
            "examples": [{"velocity": [0.5, 0, 0], "gusts": 0.2}],
            "properties": {
                "velocity": {
                    "type": "array",
                    "items": {"type": "number", "minimum": -20, "maximum": 20},
                    "minItems": 3,
                    "maxItems": 3,
                    "default": [0.0, 0.0, 0.0],
                    "description": "Mean velocity of the air, map frame, m/s.",
                },
                "gusts": number(
                    "Standard deviation of the gusts along each axis, m/s; each drone has its own.",
                    minimum=0,
                    maximum=10,
                    default=0.0,
                ),
                "gust_time": positive("Correlation time of the gusts, s.", default=2.0),
            },
        },
        "radio": {
            "type": "object",
            "additionalProperties": False,
            "description": "Loss and delay of the radio link, if there is noise; by default those "
            "of the profile.",
            "examples": [{"setpoint_loss": 0.2, "report_loss": 0.2}],
            "properties": {
                "report_loss": camera_options.of_profile(
                    1, "Fraction of the drones' reports that are lost."
                ),
                "setpoint_loss": camera_options.of_profile(
                    1, "Fraction of the setpoints that are lost (commands are sent again)."
                ),
                "report_delay": camera_options.of_profile(
                    2, "Time until a report arrives, in steps of 0.01 s."
                ),
                "setpoint_delay": camera_options.of_profile(
                    2, "Time until a setpoint or a command arrives, s."
                ),
            },
        },
        "camera": camera_options.OPTIONS,
        "positioning": POSITIONING,
        "onboard": ONBOARD,
    },
}


def make(scene: Scene, **options: Any) -> Transport:
    """Return the simulator of a scene's agents."""
    from star_sim.transport import Simulator

    return Simulator(scene, **simulator_arguments(**options))


def simulator_arguments(
    *,
    profile: str,
    camera: Mapping[str, Any] | None = None,
    radio: Mapping[str, Any] | None = None,
    aerodynamics: bool | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Return the arguments of `Simulator` for options of a mission, defaults included."""
    errors = replace(PROFILES[profile], **radio or {})
    if aerodynamics is not None:
        errors = replace(errors, aerodynamics=aerodynamics)
    resolved = camera_options.camera_options(errors, **camera or {})
    return options | {"profile": errors, "camera": None if resolved.mode == "off" else resolved}


def ideal_world(**changes: Any) -> dict[str, Any]:
    """Return arguments of `Simulator` for a world that is kinder than a real one, with changes."""
    ideal = {"profile": "ideal", "controller": "ideal", "camera": {"mode": "off"}}
    return simulator_arguments(**fill_defaults(ideal, OPTIONS)) | changes


def check(
    scene: Scene, *, camera: Mapping[str, Any] | None = None, **_others: Any
) -> Iterable[Problem]:
    """Yield covered landmarks and targets that the world does not have."""
    from difflib import get_close_matches

    names = {tag.of for tag in (*scene.world.landmarks, *scene.world.targets)}
    for i, name in enumerate((camera or {}).get("covered", ())):
        if name not in names:
            near = "".join(
                f"; did you mean {match!r}?" for match in get_close_matches(name, names, 1)
            )
            reason = f"world {scene.world.name!r} has no landmark {name!r}{near}"
            yield Problem(("camera", "covered", i), reason, "unknown-landmark")


def heights_above_surface(*, noise: bool, profile: str, **others: Any) -> bool:
    """Return whether the estimators measure heights from obstacles below."""
    return noise and PROFILES[profile].surfaces and flow_deck(**others)


def flow_deck(*, onboard: Mapping[str, Any] | None = None, **_others: Any) -> bool:
    """Return whether the drones carry Flow decks."""
    return onboard is None or bool(onboard.get("flow_deck", True))


def exact_odometry(*, noise: bool, **_others: Any) -> bool:
    """Return whether on-board estimates equal the ground truth."""
    return not noise


def exact_control(*, controller: str, **_others: Any) -> bool:
    """Return whether drones fly setpoints exactly."""
    return controller == "ideal"


def detects_tags(*, camera: Mapping[str, Any] | None = None, **_others: Any) -> bool:
    """Return whether drones with these options send corners of tags instead of images."""
    return (camera or {}).get("mode") == "geometric"


def measures_positions(*, positioning: Mapping[str, Any] | None = None, **_others: Any) -> bool:
    """Return whether there is a positioning system."""
    return positioning is not None


def measurement_errors(
    *, positioning: Mapping[str, Any] | None = None, **_others: Any
) -> tuple[float, float] | None:
    """Return the standard deviation of measured positions, m, and the longest gap, s."""
    if positioning is None:
        return None
    dropout = positioning["dropout_time"] if positioning["dropout_rate"] > 0 else 0.0
    return positioning["std"], dropout + 1 / positioning["rate"] + positioning["latency"]


def onboard_system(*, onboard: Mapping[str, Any] | None = None, **_others: Any) -> str | None:
    """Return the positioning system by which the on-board estimators know the map."""
    return None if onboard is None else onboard.get("system")


@hookimpl
def star_transports() -> Iterable[TransportSpec]:
    yield TransportSpec(
        name="sim",
        summary="Simulated Crazyflies with Flow decks, with realistic drift.",
        make=make,
        options=OPTIONS,
        check=check,
        realtime=False,
        heights_above_surface=heights_above_surface,
        flow_deck=flow_deck,
        exact_odometry=exact_odometry,
        exact_control=exact_control,
        detects_tags=detects_tags,
        measures_positions=measures_positions,
        measurement_errors=measurement_errors,
        onboard_system=onboard_system,
        hover_voltage=deferred("star_sim.discharge:hover_voltage"),
    )
