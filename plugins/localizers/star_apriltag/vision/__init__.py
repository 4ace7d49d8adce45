"""From a grey image to tags that can be believed: lens, detector, pose and gate."""
