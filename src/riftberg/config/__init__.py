"""What users may set: typed values with units, parameter groups, limits and usual ranges."""
