"""How laws are composed in time: multiple time steps, single-step Verlet, Runge-Kutta, and the choice of sub-step."""
