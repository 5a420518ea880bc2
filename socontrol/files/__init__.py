"""Files: YAML in, records out."""
