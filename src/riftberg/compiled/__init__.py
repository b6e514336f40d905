"""How numba compiles the kernels and where their machine code is kept."""
