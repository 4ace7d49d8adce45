"""Distances and shapes: obstacles, polygons, pairs of agents, footprints."""
