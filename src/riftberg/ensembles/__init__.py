"""Many runs side by side: an experiment with parameters varied, its members on all cores or machines, one result."""
