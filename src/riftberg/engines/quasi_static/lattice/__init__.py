"""The elastic lattice: equilibrium, block LDL^T, natural modes."""
