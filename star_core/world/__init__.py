"""The static environment as plain numbers: geofence, obstacles, tags and cameras."""
