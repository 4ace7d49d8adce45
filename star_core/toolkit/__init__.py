"""What plugins share: position control, camera model, poses of squares, trajectories, timeouts."""
