"""The verb ``follow``: a path or a trajectory that is flown, by the core or on board."""
