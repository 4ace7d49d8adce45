"""The record of a flight: its manifest and summary, and the reader of its folder."""
