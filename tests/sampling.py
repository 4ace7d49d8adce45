"""How many examples of Hypothesis a test tries whose examples take long."""

from __future__ import annotations

from hypothesis import settings


def share_of_examples(share: float) -> settings:
    """Return settings with a share of the examples of the profile, of which each try takes long."""
    profile = settings.default
    assert profile is not None
    return settings(max_examples=max(1, round(share * profile.max_examples)))
