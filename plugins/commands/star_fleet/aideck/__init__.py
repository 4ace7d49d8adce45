"""The AI-decks of simulated Crazyflies: their camera streams, and their links over WiFi."""
