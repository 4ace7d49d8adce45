"""What authors of plugins and of scripts need, and nothing else.

Names are imported when they are first used (PEP 562), so that a plugin that only announces itself
costs no numpy.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is slow to import
if TYPE_CHECKING:
    from star_core.camera import Camera
    from star_core.contracts import (
        Avoider,
        Localizer,
        Offer,
        Planner,
        Problem,
        Status,
        Step,
        Task,
        Transport,
    )
    from star_core.errors import ContractError, InputError, PluginError, StarError
    from star_core.flight import Corrected, Event, Flight, Tick
    from star_core.frames import Transform
    from star_core.ground import footprint
    from star_core.homing import Homing
    from star_core.hookspecs import hookimpl
    from star_core.kernels import compiled
    from star_core.mission import Mission, load
    from star_core.orders import Command, Order, Trajectory
    from star_core.registry import Registry
    from star_core.runner import fly
    from star_core.runs import new_folder
    from star_core.scene import Agent, Limits, Scene
    from star_core.schema import read_as
    from star_core.sight import Corrections, Detections, Frames, Image, Sightings
    from star_core.steps import actions
    from star_core.swarm import AgentPhase, Estimate, Goals, Health, Paths, Plan, Setpoint, Truth
    from star_core.table import Array, Mask, Rows
    from star_core.telemetry import Odometry, Refusal, Supervisor, Telemetry
    from star_core.world import Fence, Obstacle, Tag, World

_HOME = {
    "star_core.camera": ("Camera",),
    "star_core.contracts": (
        "Avoider", "Localizer", "Offer", "Planner", "Problem", "Status", "Step", "Task",
        "Transport",
    ),
    "star_core.errors": ("ContractError", "InputError", "PluginError", "StarError"),
    "star_core.flight": ("Corrected", "Event", "Flight", "Tick"),
    "star_core.frames": ("Transform",),
    "star_core.ground": ("footprint",),
    "star_core.homing": ("Homing",),
    "star_core.hookspecs": ("hookimpl",),
    "star_core.kernels": ("compiled",),
    "star_core.mission": ("Mission", "load"),
    "star_core.registry": ("Registry",),
    "star_core.runner": ("fly",),
    "star_core.runs": ("new_folder",),
    "star_core.schema": ("read_as",),
    "star_core.scene": ("Agent", "Limits", "Scene"),
    "star_core.sight": ("Corrections", "Detections", "Frames", "Image", "Sightings"),
    "star_core.steps": ("actions",),
    "star_core.orders": ("Command", "Order", "Trajectory"),
    "star_core.swarm": (
        "AgentPhase", "Estimate", "Goals", "Health", "Paths", "Plan", "Setpoint", "Truth",
    ),
    "star_core.table": ("Array", "Mask", "Rows"),
    "star_core.telemetry": ("Odometry", "Refusal", "Supervisor", "Telemetry"),
    "star_core.world": ("Fence", "Obstacle", "Tag", "World"),
}  # fmt: skip
_HOME_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Agent",
    "AgentPhase",
    "Array",
    "Avoider",
    "Camera",
    "Command",
    "ContractError",
    "Corrected",
    "Corrections",
    "Detections",
    "Estimate",
    "Event",
    "Fence",
    "Flight",
    "Frames",
    "Goals",
    "Health",
    "Homing",
    "Image",
    "InputError",
    "Limits",
    "Localizer",
    "Mask",
    "Mission",
    "Obstacle",
    "Odometry",
    "Offer",
    "Order",
    "Paths",
    "Plan",
    "Planner",
    "PluginError",
    "Problem",
    "Refusal",
    "Registry",
    "Rows",
    "Scene",
    "Setpoint",
    "Sightings",
    "StarError",
    "Status",
    "Step",
    "Supervisor",
    "Tag",
    "Task",
    "Telemetry",
    "Tick",
    "Trajectory",
    "Transform",
    "Transport",
    "Truth",
    "World",
    "actions",
    "compiled",
    "fly",
    "footprint",
    "hookimpl",
    "load",
    "new_folder",
    "read_as",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("star-swarm")
    try:
        module = import_module(_HOME_OF[name])
    except KeyError:
        raise AttributeError(f"module 'star_core' has no attribute {name!r}") from None
    return getattr(module, name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
