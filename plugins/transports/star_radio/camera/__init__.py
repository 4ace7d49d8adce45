"""AI-deck cameras, read over WiFi."""
