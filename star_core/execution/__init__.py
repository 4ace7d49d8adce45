"""The steps of a mission while they run: goals, assignments, reserves, landings."""
