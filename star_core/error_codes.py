"""The catalogue of error codes: what each means and what to do about it.

`star errors` prints it, and ``star errors > docs/errors.md`` writes the page of the documentation.
Codes have lower-case words and at least one hyphen. Prefer an existing code to a new one.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from star_core.errors import InputError, suggestion


class Entry(NamedTuple):
    """One code: what it means and how to correct the error, a sentence each."""

    meaning: str
    remedy: str


CATALOGUE: Final = {
    "above-limit": Entry(
        "A speed or an acceleration is above one of the mission's limits.",
        "Reduce it, or raise the limit if the drones can fly it.",
    ),
    "address-in-use": Entry(
        "A network address or port cannot be opened.",
        "Choose another one, or end the program that uses it.",
    ),
    "agent-conflict": Entry(
        "Two steps that run at once, or a step and its condition, use the same agent.",
        "Name different agents in each.",
    ),
    "agent-not-in-mission": Entry(
        "A step is for agents that are in reserve or have left the mission.",
        "Use other agents, or add a `join` before.",
    ),
    "agents-unreachable": Entry(
        "Drones cannot be connected to.",
        "Switch them on, and correct their `uri`; the message states a reason for each.",
    ),
    "calibration-failed": Entry(
        "The images do not determine a camera.",
        "Take more of them, sharp, with the whole board in each, tilted to all sides.",
    ),
    "circular-include": Entry(
        "A file of steps includes itself, directly or through others.",
        "Remove one of the includes.",
    ),
    "contract-broken": Entry(
        "A plugin returned something that its contract does not allow.",
        "Correct the plugin; `star_core.testing` checks it without a flight.",
    ),
    "duplicate-address": Entry(
        "Two agents, cameras or dongles have the same address.",
        "Give each its own address.",
    ),
    "duplicate-item": Entry(
        "A list has an item twice.",
        "Remove one of them.",
    ),
    "duplicate-name": Entry(
        "Two things have the same name.",
        "Rename one of them.",
    ),
    "duplicate-plugin": Entry(
        "Two installed plugins have the same name.",
        "Uninstall one of them.",
    ),
    "duplicate-tag": Entry(
        "Two tags of a world have the same number.",
        "Give each tag its own number.",
    ),
    "empty-range": Entry(
        "A range is empty, or has nothing in common with the geofence.",
        "Correct the numbers that the message names.",
    ),
    "estimator-unsettled": Entry(
        "The state estimator of a drone has not converged.",
        "Attach the Flow deck, and do not move the drone while it connects.",
    ),
    "fence-too-near": Entry(
        "The safety rule `fence_near` would trigger at once.",
        "Reduce `within`, or move the start or the height away from the fence.",
    ),
    "file-exists": Entry(
        "A file that would be written exists already.",
        "Choose another name or folder, or remove the file.",
    ),
    "file-not-found": Entry(
        "There is no file of that name.",
        "Correct the name; files of a mission are looked up in the mission's folder.",
    ),
    "inside-obstacle": Entry(
        "A position or a climb is inside an obstacle.",
        "Move it, or correct the obstacle in the world file.",
    ),
    "invalid-address": Entry(
        "A network address has a wrong form.",
        "Write it like the example in the message.",
    ),
    "invalid-answer": Entry(
        "A drone sent an answer that is not part of the protocol.",
        "Update its firmware.",
    ),
    "invalid-argument": Entry(
        "The command line has an argument that the command does not accept.",
        "`star COMMAND --help` lists the arguments.",
    ),
    "invalid-assignment": Entry(
        "An assignment of `--set` cannot be followed.",
        "Write `--set path.to.value=VALUE`, with keys and indices of the mission joined by dots.",
    ),
    "invalid-camera": Entry(
        "The description of a camera contradicts itself.",
        "Correct the values that the message names.",
    ),
    "invalid-input": Entry(
        "A file or an option cannot be used as it is.",
        "Correct it as the message describes.",
    ),
    "invalid-message": Entry(
        "An external process or planner sent something that `external` does not accept.",
        "`docs/missions.md` describes the protocol; goals must respect fence, heights and limits.",
    ),
    "invalid-name": Entry(
        "A name has characters that are not allowed.",
        "Use the form that the message describes.",
    ),
    "invalid-option": Entry(
        "An option has a value that cannot be used in this mission.",
        "`star plugins NAME` describes the options of a plugin.",
    ),
    "invalid-outline": Entry(
        "The outline of an obstacle is not a simple polygon or line.",
        "Correct its points.",
    ),
    "invalid-path": Entry(
        "A file is outside the folder that may be read.",
        "Move it to the folder that the message names.",
    ),
    "invalid-polygon": Entry(
        "The corners of an outline do not enclose an area.",
        "Give the corners in order around it, each once, so that no two sides meet.",
    ),
    "invalid-step": Entry(
        "A step does not have the form `verb: {options}`.",
        "Write one verb for each step, with its options indented below.",
    ),
    "invalid-trajectory": Entry(
        "A file of waypoints or of a polynomial trajectory has invalid contents.",
        "Correct the line that the message names; `docs/missions.md` describes both formats.",
    ),
    "invalid-value": Entry(
        "A value is not one of the possible ones, or does not have the required form.",
        "Use one of the values, or the form, that the message names.",
    ),
    "invalid-yaml": Entry(
        "A file is not YAML, or has anchors, tags, dates or non-finite numbers.",
        "Correct the reported line; put text that looks like a number in quotes.",
    ),
    "link-failed": Entry(
        "A radio, a USB device or a network cannot be opened.",
        "Plug in the dongle, and check its permissions and the address.",
    ),
    "memory-full": Entry(
        "Trajectories do not fit into the memory of a drone.",
        "Use fewer pieces or fewer trajectories, or fly them without `on_board`.",
    ),
    "misplaced-key": Entry(
        "A key is in a place where it has no meaning.",
        "Move it as the message describes.",
    ),
    "missing-camera": Entry(
        "An agent needs a camera for this step.",
        "Give it one, such as `camera: aideck`, or name agents that have one.",
    ),
    "missing-option": Entry(
        "A key or an option that is required is missing.",
        "Add it.",
    ),
    "missing-package": Entry(
        "A package is needed that is not installed.",
        "Install it; the message states the command.",
    ),
    "no-answer": Entry(
        "A device does not answer in time.",
        "Switch it on, move it closer, or raise the timeout.",
    ),
    "no-camera": Entry(
        "A plugin needs images, but no agent has a camera.",
        "Give agents a camera, or use another plugin.",
    ),
    "no-record": Entry(
        "A folder does not hold the complete record of a flight or of a study.",
        "Name the folder that `star run` or `star ablate` wrote; `docs/record.md` lists its files.",
    ),
    "no-tags": Entry(
        "A world has no tags where some are needed.",
        "Add landmarks or targets to the world, or use another one.",
    ),
    "option-conflict": Entry(
        "Two options exclude each other, or one needs another.",
        "Remove or add the option that the message names.",
    ),
    "out-of-range": Entry(
        "A number is too small or too large in this mission.",
        "The message states the range.",
    ),
    "outdated-firmware": Entry(
        "The firmware of a drone lacks something that the mission needs.",
        "Update the firmware, or remove the option that needs it.",
    ),
    "outside-geofence": Entry(
        "A position or a height is outside the geofence or the heights to fly at.",
        "Move it inside the fence of the world and `limits.height`.",
    ),
    "overlapping-tags": Entry(
        "Two tags of a world overlap.",
        "Move one of them.",
    ),
    "paper-too-small": Entry(
        "A tag does not fit on the paper.",
        "Use the paper that the message names, or a smaller tag.",
    ),
    "path-blocked": Entry(
        "An obstacle is in the straight way of an agent, and the planner ignores obstacles.",
        "Use a planner that avoids them, or go around with more waypoints.",
    ),
    "plugin-failed": Entry(
        "A plugin raised an error.",
        "`star run --verbose` shows its traceback; report it to the plugin's author.",
    ),
    "radio-overload": Entry(
        "The agents of a dongle need more packets than it can carry.",
        "Lower the mission's rate, report less often, or add a dongle; see the figures.",
    ),
    "refused-request": Entry(
        "A drone refuses a request.",
        "The message has the error that the drone reports.",
    ),
    "resource-conflict": Entry(
        "Two steps that begin at once hold the same resource, such as a port.",
        "Give each its own.",
    ),
    "start-in-air": Entry(
        "An agent starts in the air, with neither the floor nor an obstacle below it.",
        "Correct the height of the start, or add what the agent stands on to the world.",
    ),
    "timeout-too-short": Entry(
        "A step takes longer than its timeout, even if nothing is in the way.",
        "Increase `timeout`, or omit it: every step has one of its own.",
    ),
    "too-close": Entry(
        "Two positions are closer to each other than the separation or the spacing allows.",
        "Move one of them, or increase the spacing.",
    ),
    "too-few-agents": Entry(
        "A step needs more agents than it has.",
        "Add agents to the step, or ask for less.",
    ),
    "unknown-agent": Entry(
        "No agent has this name.",
        "Correct the name; agents are listed under `swarm`.",
    ),
    "unknown-camera": Entry(
        "No camera has this name.",
        "Correct the name, or add the camera under `cameras:`.",
    ),
    "unknown-code": Entry(
        "No error has this code.",
        "`star errors` lists all codes.",
    ),
    "unknown-landmark": Entry(
        "The world has no landmark or target of that name.",
        "Correct the name; the world's file lists its landmarks and targets.",
    ),
    "unknown-mission": Entry(
        "There is no file of that name, and no mission of that name comes with STAR.",
        "Correct the path, or name one that `star missions` lists.",
    ),
    "unknown-option": Entry(
        "A key or an option does not exist.",
        "Correct its name; `star plugins NAME` describes the options of a plugin.",
    ),
    "unknown-parameter": Entry(
        "A parameter is not one of the included file.",
        "Correct its name, or add it under `parameters:` of that file.",
    ),
    "unknown-plugin": Entry(
        "No plugin of that name is installed.",
        "Correct the name, or install the plugin; the message lists those that are installed.",
    ),
    "unknown-target": Entry(
        "The world has no target of that name.",
        "Correct the name; the message lists the targets or the most similar one.",
    ),
    "unknown-verb": Entry(
        "No installed plugin has this verb.",
        "Correct the verb; `star plugins` lists all verbs.",
    ),
    "unreachable-goal": Entry(
        "A goal of a step is outside the geofence, in an obstacle, or refused by the planner.",
        "Move the goal as the message describes.",
    ),
    "unreadable-file": Entry(
        "A file exists but cannot be read.",
        "Check that it is a file of the expected format, not a folder, and readable by you.",
    ),
    "unsupported-version": Entry(
        "The file is of another version of the mission language.",
        "Use the version of STAR that the file was written for.",
    ),
    "unwritable-file": Entry(
        "A file or folder cannot be written, or must not be overwritten.",
        "Name another one, in a folder that exists and is writable by you.",
    ),
    "wrong-airborne-state": Entry(
        "A step needs its agents in the air or on the ground, where they are not.",
        "Add `takeoff` or `land` before it.",
    ),
    "wrong-file": Entry(
        "The file is of another kind than the command expects.",
        "Name a mission; `star check` accepts worlds, cameras and steps too.",
    ),
    "wrong-image-size": Entry(
        "An image has a size that differs from the others, or that no camera has.",
        "Take all images with the camera that is calibrated, without scaling them.",
    ),
    "wrong-length": Entry(
        "A list, a text or a map has too few or too many items.",
        "The message states the expected number.",
    ),
    "wrong-shape": Entry(
        "A table of a plugin has a wrong number of rows or columns.",
        "Return one row per agent, in the order of the swarm.",
    ),
    "wrong-type": Entry(
        "A value is of another type than expected, such as text instead of a number.",
        "Write a value of the expected type; put text that looks like a number in quotes.",
    ),
}


def explain(code: str) -> str:
    """Return the meaning and the remedy of a code.

    Raises:
        InputError: There is no such code.
    """
    if code not in CATALOGUE:
        hint = suggestion(code, CATALOGUE) or "; `star errors` lists all codes"
        raise InputError(f"no error has the code {code!r}{hint}", "unknown-code")
    return "\n".join(CATALOGUE[code])


def page() -> str:
    """Return the catalogue as a page of Markdown."""
    rows = [f"| `{code}` | {one.meaning} | {one.remedy} |" for code, one in CATALOGUE.items()]
    return "\n".join([
        "# Errors",
        "",
        "Every error ends with a code in brackets, such as `[file-not-found]`. `star errors CODE`",
        "explains one. This page is generated by `star errors > docs/errors.md`.",
        "",
        "| code | meaning | what to do |",
        "|---|---|---|",
        *rows,
    ])  # fmt: skip
