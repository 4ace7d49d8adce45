"""A plugin that cannot be imported."""

raise ImportError("this plugin wants a gripper")
