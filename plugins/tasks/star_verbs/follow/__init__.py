"""The verb ``follow``: a path or a trajectory, flown by the core or on board."""
