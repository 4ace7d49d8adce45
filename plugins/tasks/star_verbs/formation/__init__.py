"""The verb ``formation``: a shape that is formed, held, and moved as one."""
