"""The data that passes between the parts of a flight: frozen tables, commands, events."""
