"""Laws of physics, one file per law: compiled functions of floats in SI units that know nothing of the rest of the house."""
