"""The data that passes between the stages of a tick: frozen tables, commands, events."""
