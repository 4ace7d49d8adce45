"""What the verbs announce."""

from __future__ import annotations

from typing import Any

import pytest

from star_core import Task, TaskSpec
from star_core.testing import scene
from star_verbs.specs import SPECS

REQUIRED: dict[str, dict[str, Any]] = {
    "goto": {"by": [0.0, 0.0, 0.1]},
    "formation": {"shape": "line", "centre": [0.0, 0.0, 0.8]},
    "follow": {"path": "box", "size": 1.0, "centre": [0.0, 0.0, 0.8]},
}


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_every_verb_makes_a_task_with_its_defaults(spec: TaskSpec, make: Any) -> None:
    assert isinstance(make(spec.name, scene(1), (0,), **REQUIRED.get(spec.name, {})), Task)
