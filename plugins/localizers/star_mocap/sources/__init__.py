"""The sources of motion capture that come with STAR, a module each."""
