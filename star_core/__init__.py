"""What authors of plugins and of scripts need, and nothing else.

Names are imported when they are first used (PEP 562), so that a plugin that only announces itself
costs no numpy.
"""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # what type checkers take for true; `typing` itself is slow to import
if TYPE_CHECKING:
    from star_core.cli.run_folders import new_folder
    from star_core.contracts import (
        Avoider,
        AvoiderSpec,
        CommandSpec,
        Exclusive,
        Localizer,
        LocalizerSpec,
        Planner,
        PlannerSpec,
        Problem,
        Status,
        StepGoal,
        Task,
        TaskOutput,
        TaskSpec,
        Transport,
        TransportSpec,
    )
    from star_core.errors import ContractError, InputError, PluginError, StarError
    from star_core.geometry.footprint import footprint
    from star_core.hookspecs import hookimpl
    from star_core.messages.arrays import Array, Mask, Rows
    from star_core.messages.commands import Command, Order, Trajectory
    from star_core.messages.events import Corrected, Event, Flight, Tick
    from star_core.messages.rotations import (
        Pose,
        quaternion_from_euler,
        rotation_from_quaternion,
        rotation_from_vector,
        skew,
        wrap_angle,
        yaw_from_quaternion,
    )
    from star_core.messages.state import (
        AgentPhase,
        Estimate,
        Goals,
        Health,
        Paths,
        Plan,
        Setpoint,
        Truth,
        with_possible_positions,
    )
    from star_core.messages.telemetry import Odometry, Refusal, Supervisor, Telemetry
    from star_core.messages.transforms import Transform
    from star_core.messages.vision import Corrections, Detections, Frames, Image, Sightings
    from star_core.mission import Mission, load
    from star_core.mission_file.schema import read_as
    from star_core.mission_file.step_tree import actions
    from star_core.plugin_schema import fill_defaults
    from star_core.registry import Registry
    from star_core.runner import fly
    from star_core.scene import Agent, Limits, Scene
    from star_core.toolkit.camera_model import CameraModel, distort, perspective
    from star_core.toolkit.jit import compiled
    from star_core.toolkit.position_control import PositionController
    from star_core.toolkit.square_pose import square_corners, square_poses
    from star_core.toolkit.timeouts import step_timeout, timeout
    from star_core.toolkit.trajectory import polynomial, transformed
    from star_core.world.camera import Camera
    from star_core.world.world import Fence, Obstacle, Tag, World

_HOME = {
    "star_core.world.camera": ("Camera",),
    "star_core.contracts": (
        "Avoider", "AvoiderSpec", "CommandSpec", "Exclusive", "Localizer", "LocalizerSpec",
        "Planner", "PlannerSpec", "Problem", "Status", "StepGoal", "Task", "TaskOutput", "TaskSpec",
        "Transport", "TransportSpec",
    ),
    "star_core.errors": ("ContractError", "InputError", "PluginError", "StarError"),
    "star_core.messages.events": ("Corrected", "Event", "Flight", "Tick"),
    "star_core.messages.transforms": ("Transform",),
    "star_core.geometry.footprint": ("footprint",),
    "star_core.toolkit.position_control": ("PositionController",),
    "star_core.hookspecs": ("hookimpl",),
    "star_core.toolkit.jit": ("compiled",),
    "star_core.mission": ("Mission", "load"),
    "star_core.plugin_schema": ("fill_defaults",),
    "star_core.registry": ("Registry",),
    "star_core.runner": ("fly",),
    "star_core.cli.run_folders": ("new_folder",),
    "star_core.mission_file.schema": ("read_as",),
    "star_core.scene": ("Agent", "Limits", "Scene"),
    "star_core.messages.vision": ("Corrections", "Detections", "Frames", "Image", "Sightings"),
    "star_core.mission_file.step_tree": ("actions",),
    "star_core.messages.commands": ("Command", "Order", "Trajectory"),
    "star_core.messages.state": (
        "AgentPhase", "Estimate", "Goals", "Health", "Paths", "Plan", "Setpoint", "Truth",
        "with_possible_positions",
    ),
    "star_core.messages.arrays": ("Array", "Mask", "Rows"),
    "star_core.messages.telemetry": ("Odometry", "Refusal", "Supervisor", "Telemetry"),
    "star_core.toolkit.camera_model": ("CameraModel", "distort", "perspective"),
    "star_core.messages.rotations": (
        "Pose", "quaternion_from_euler", "rotation_from_quaternion", "rotation_from_vector",
        "skew", "wrap_angle", "yaw_from_quaternion",
    ),
    "star_core.toolkit.square_pose": ("square_corners", "square_poses"),
    "star_core.toolkit.timeouts": ("step_timeout", "timeout"),
    "star_core.toolkit.trajectory": ("polynomial", "transformed"),
    "star_core.world.world": ("Fence", "Obstacle", "Tag", "World"),
}  # fmt: skip
_HOME_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Agent",
    "AgentPhase",
    "Array",
    "Avoider",
    "AvoiderSpec",
    "Camera",
    "CameraModel",
    "Command",
    "CommandSpec",
    "ContractError",
    "Corrected",
    "Corrections",
    "Detections",
    "Estimate",
    "Event",
    "Exclusive",
    "Fence",
    "Flight",
    "Frames",
    "Goals",
    "Health",
    "Image",
    "InputError",
    "Limits",
    "Localizer",
    "LocalizerSpec",
    "Mask",
    "Mission",
    "Obstacle",
    "Odometry",
    "Order",
    "Paths",
    "Plan",
    "Planner",
    "PlannerSpec",
    "PluginError",
    "Pose",
    "PositionController",
    "Problem",
    "Refusal",
    "Registry",
    "Rows",
    "Scene",
    "Setpoint",
    "Sightings",
    "StarError",
    "Status",
    "StepGoal",
    "Supervisor",
    "Tag",
    "Task",
    "TaskOutput",
    "TaskSpec",
    "Telemetry",
    "Tick",
    "Trajectory",
    "Transform",
    "Transport",
    "TransportSpec",
    "Truth",
    "World",
    "actions",
    "compiled",
    "distort",
    "fill_defaults",
    "fly",
    "footprint",
    "hookimpl",
    "load",
    "new_folder",
    "perspective",
    "polynomial",
    "quaternion_from_euler",
    "read_as",
    "rotation_from_quaternion",
    "rotation_from_vector",
    "skew",
    "square_corners",
    "square_poses",
    "step_timeout",
    "timeout",
    "transformed",
    "with_possible_positions",
    "wrap_angle",
    "yaw_from_quaternion",
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
