"""What is measured of a flight, and what is recorded of how it was set up."""
