"""The plan of a mission on a page: pads, and the steps and paths of its rehearsal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

import numpy as np
import viser

from star_core import Agent, Array, Mission, Registry
from star_core.toolkit import Rehearsal, RehearsedStep, actions, shortlist
from star_view.footprints import footprint
from star_view.markdown import escaped
from star_view.names import Name
from star_view.page import Page
from star_view.swarm_scene import CIRCLE, Footprint, color_of, dashes, segments, switch
from star_view.world_scene import add_lines

PAD: Final = 0.15  # m, radius of a pad
PAD_HEIGHT: Final = 0.004  # m above the floor, so that the floor does not shine through
MAX_LABELS: Final = 40  # of steps: more hide the scene
WIDTH: Final = 1.5  # px


class PlannedStep(NamedTuple):
    """A step of the rehearsal.

    Attributes:
        text: Verb and agents, and the expected duration.
        verb: Of the mission language.
        paths: Corners, (K, 3) m, of the path of each agent, by name.
    """

    text: str
    verb: str
    paths: Mapping[str, Array]


def planned_steps(mission: Mission, registry: Registry) -> list[PlannedStep]:
    """Return the steps of a rehearsal, each once, in the order of the mission.

    There are none if no plugin rehearses missions.
    """
    rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    if rehearsal is None:
        return []
    first = {id(step.action): step for step in reversed(rehearsal.steps)}
    return [
        _planned(first[id(action)], rehearsal, mission)
        for action in actions(mission.steps)
        if id(action) in first
    ]


def add_plan(server: Page, agents: Sequence[Agent], steps: Sequence[PlannedStep]) -> None:
    """Add the agents' pads, the planned paths, first camera footprints, and the list of steps."""
    page, names = server.scene, [agent.name for agent in agents]
    layers = [page.add_frame(f"/{name}", show_axes=False) for name in ("pads", "plan")]
    ends = {agent.name: np.array(agent.start) for agent in agents}
    for row, agent in enumerate(agents):
        _add_start(page, agent, steps, row)
    labels: dict[tuple[float, float, float], list[str]] = {}  # by their positions
    for number, step in enumerate(steps, start=1):
        for name, path in step.paths.items():
            ends[name], color = path[-1], color_of(names.index(name))
            if len(path) > 1:
                add_lines(page, f"/plan/{number}/{name}", dashes(path), color, WIDTH)
                x, y, z = path[-1].round(1).tolist()
                labels.setdefault((x, y, z), []).append(f"{number} {step.verb}")
    server.names += [
        Name(f"/plan/labels/{i}", ", ".join(texts), position, below=True)
        for i, (position, texts) in enumerate(labels.items() if len(labels) <= MAX_LABELS else ())
    ]
    for row, name in enumerate(names):
        if ends[name][2] < PAD:
            _add_pad(page, f"/pads/landing/{name}", ends[name], color_of(row), filled=False)
    with server.gui.add_folder("plan", expand_by_default=len(steps) <= MAX_LABELS):
        for label, layer in zip(("pads", "planned steps"), layers, strict=True):
            server.gui.add_checkbox(label, initial_value=True).on_update(partial(switch, layer))
        server.gui.add_markdown(
            "\n".join(
                f"{number}. {escaped(step.text)}" for number, step in enumerate(steps, start=1)
            )
        )


def _add_start(page: viser.SceneApi, agent: Agent, steps: Sequence[PlannedStep], row: int) -> None:
    """Add an agent's pad, and what its camera sees of the floor where the agent first hovers."""
    _add_pad(page, f"/pads/start/{agent.name}", np.array(agent.start), color_of(row), filled=True)
    if agent.camera is None:
        return
    level = np.array([0.0, 0.0, math.sin(agent.yaw / 2), math.cos(agent.yaw / 2)])
    ends = (step.paths[agent.name][-1] for step in steps if agent.name in step.paths)
    views = (footprint(agent.camera, end, level) for end in ends)
    view = next((view for view in views if len(view)), None)  # none is seen from the floor
    if view is not None:
        Footprint(page, f"/plan/footprints/{agent.name}", row).draw(view)


def _planned(step: RehearsedStep, rehearsal: Rehearsal, mission: Mission) -> PlannedStep:
    """Return a step of a rehearsal; of one that is repeated, the first round."""
    names, verb = [mission.scene.agents[row].name for row in step.rows], step.action.verb
    takes = "" if step.duration is None else f", about {step.duration:.1f} s"
    problem = f" — {step.problem}" if step.problem else ""
    paths = {name: rehearsal.path(step, row) for name, row in zip(names, step.rows, strict=True)}
    return PlannedStep(f"{verb} {shortlist(names)}{takes}{problem}", verb, paths)


def _add_pad(
    page: viser.SceneApi, name: str, at: Array, color: tuple[int, int, int], *, filled: bool
) -> None:
    """Add the pad of a start, a disc, or of a landing, a ring."""
    middle = np.array([at[0], at[1], PAD_HEIGHT])
    if filled:
        page.add_cylinder(
            name, radius=PAD, height=PAD_HEIGHT, color=color, opacity=0.35, position=middle,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
    else:
        add_lines(page, name, segments(middle + PAD * CIRCLE), color, WIDTH)
