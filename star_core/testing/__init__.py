"""Checks for the tests of plugin authors: whether a plugin keeps its contract.

Each check makes a plugin for swarms of 1, 2 and 50 agents, calls it with inputs that occur in
flight (agents that are not located, that stand on the ground, that are all at one point), and
raises `ContractError` at the first violation. A second plugin, made alike, must return the same.
In a plugin's tests:

    from star_core.testing import check_avoider

    def test_it_keeps_the_contract():
        check_avoider(lambda scene: MyAvoider(scene, radius=0.4))

``make`` makes the plugin for a scene, ``scene`` the scene of a number of agents. The message of an
error begins with the case. Every check returns the mean time of a call, s, by the number of agents;
pytest prints it.

`PointMasses` is a transport to points; `MissionSteps` runs the steps of a mission without the rest
of a flight.
"""

from star_core.lazy_names import lazy_names

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
