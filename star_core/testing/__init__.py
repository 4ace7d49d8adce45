"""Checks for the tests of plugin authors: whether a plugin keeps its contract.

Each check makes a plugin for swarms of 1, 2 and 50 agents, calls it with inputs that occur in
flight (agents that are not located, that stand on the ground, that are all at one point), and
raises `ContractError` at the first violation. A second plugin, made alike, must return the same.
In a plugin's tests::

    from star_core.testing import check_avoider

    def test_it_keeps_the_contract():
        check_avoider(lambda scene: MyAvoider(scene, radius=0.4))

``make`` makes the plugin for a scene, ``scene`` the scene of a number of agents. The message of an
error begins with the case. Every check returns the mean time of a call, s, by the number of agents;
pytest prints it.
"""

from star_core.testing.calls import SIZES, Times, reports
from star_core.testing.inputs import estimate, health, scene
from star_core.testing.steering import check_avoider, check_localizer, check_planner
from star_core.testing.task import check_task
from star_core.testing.transport import check_transport

__all__ = [
    "SIZES",
    "Times",
    "check_avoider",
    "check_localizer",
    "check_planner",
    "check_task",
    "check_transport",
    "estimate",
    "health",
    "reports",
    "scene",
]
