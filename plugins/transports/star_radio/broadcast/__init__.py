"""Broadcasts to all Crazyflies of a channel, by an additional Crazyradio."""
