"""Mission, world and camera files: located YAML, schema, includes, error messages."""
