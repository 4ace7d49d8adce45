"""The cameras of AI-decks, read over WiFi."""
