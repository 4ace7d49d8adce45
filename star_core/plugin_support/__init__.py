"""Plugins: specs, entry points, hooks, options, guards, times, checks of what they return."""
