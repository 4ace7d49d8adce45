"""What is wrong with a mission that its schema cannot see."""
