"""Other people's code in a flight: schemas of options, guards, the watchdog, checks of outputs."""
