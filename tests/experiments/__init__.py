"""Built-in experiments and YAML files."""
